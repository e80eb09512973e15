r"""Depthwise: convolutions in which each group has one channel.

A product with one channel is slow, because it reads as many values as it multiplies. Large maps are filtered by OpenCV,
which computes an output from all its inputs at once. Small maps of many channels are weighted sums of long vectors, one
per element of the kernel: the padded maps are adjacent in memory, so a shift by rows and columns is one number.

Both compute the outputs of stride 1, of which a stride selects some. The gradient of x is the same sum of dy with the
flipped kernel, with zeros between the values of dy for a stride.
"""

from __future__ import annotations

from collections.abc import Iterator

import cv2
import numpy as np

from fast.geometry import Geometry, at, run_parts
from fast.parallel import scratch
from netlib.blob import Array
from netlib.system.memory import blocks

ALL = slice(None)
FILTERED = 1500  # values of padded maps from which calls of OpenCV take less time than sums of vectors
MAX_VALUES = 1 << 15  # of the maps of a channel in a block
VALUE = 20  # multiplications in a product that take as long as one in a depthwise convolution


class Depthwise:
    """The algorithm for images with one channel per group, and any number of outputs of it."""

    def correlate(self, g: Geometry, x: Array, w: Array, bias: Array | None, y: Array) -> None:
        """Write y."""
        C, sizes, outputs = x.shape[1], x.shape[2:], y.shape[2:]
        kernels = w.reshape(C, -1, *g.kernel)
        steps = tuple(slice(0, (n - 1) * s + 1, s) for n, s in zip(outputs, g.stride))
        target = y.reshape(len(x), C, y.shape[1] // C, *outputs)
        biases = None if bias is None else bias.reshape(C, -1, 1, 1, 1)

        def job(part: slice) -> None:
            for images, channels, maps in _maps(x, part, g.padded(sizes)):
                maps[at(ALL, g.inside(sizes))] = x[images, channels].swapaxes(0, 1)
                for m in range(kernels.shape[1]):
                    found = _filter(maps, kernels[channels, m], g.dilation)[at(ALL, steps)]
                    out = target[images, channels, m].swapaxes(0, 1)
                    if biases is None:
                        out[...] = found
                    else:
                        np.add(found, biases[channels, m], out=out)

        run_parts(job, C, C, y.size * w[0].size * VALUE)

    def transpose(self, g: Geometry, dy: Array, w: Array, bias: Array | None, dx: Array) -> None:
        """Write dx."""
        C, sizes, outputs = dx.shape[1], dx.shape[2:], dy.shape[2:]
        kernels = w.reshape(C, -1, *g.kernel)[..., ::-1, ::-1]
        reach = [d * (k - 1) for d, k in zip(g.dilation, g.kernel)]
        padded = tuple(n + r for n, r in zip(g.padded(sizes), reach))
        places = tuple(slice(r, r + (n - 1) * s + 1, s) for r, n, s in zip(reach, outputs, g.stride))
        gradient = dy.reshape(len(dy), C, dy.shape[1] // C, *outputs)

        def job(part: slice) -> None:
            for images, channels, maps in _maps(dx, part, padded):
                out = dx[images, channels].swapaxes(0, 1)
                for m in range(kernels.shape[1]):
                    maps[at(ALL, places)] = gradient[images, channels, m].swapaxes(0, 1)
                    found = _filter(maps, kernels[channels, m], g.dilation)[at(ALL, g.inside(sizes))]
                    if m:
                        out += found
                    elif bias is None:
                        out[...] = found
                    else:
                        np.add(found, bias[channels, None, None, None], out=out)

        run_parts(job, C, C, dy.size * w[0].size * VALUE)

    def gradient(self, g: Geometry, x: Array, dy: Array, dw: Array) -> None:
        """Add to dw."""
        C, sizes, outputs = x.shape[1], x.shape[2:], dy.shape[2:]
        total = dw.reshape(C, -1, *g.kernel)
        steps = tuple(slice(0, (n - 1) * s + 1, s) for n, s in zip(outputs, g.stride))
        gradient = dy.reshape(len(dy), C, dy.shape[1] // C, *outputs)

        def job(part: slice) -> None:
            for images, channels, maps in _maps(x, part, g.padded(sizes)):
                maps[at(ALL, g.inside(sizes))] = x[images, channels].swapaxes(0, 1)
                spread = scratch("filtered", maps.shape, maps.dtype)
                spread[...] = 0
                for m in range(total.shape[1]):
                    spread[at(ALL, steps)] = gradient[images, channels, m].swapaxes(0, 1)
                    windows = _windows(maps, g)
                    values = spread.reshape(len(maps), -1)[:, : windows.shape[-1]]
                    total[channels, m] += np.einsum("cijl,cl->cij", windows, values)

        run_parts(job, C, C, dy.size * dw[0].size * VALUE)


def _maps(x: Array, part: slice, padded: tuple[int, ...]) -> Iterator[tuple[slice, slice, Array]]:
    """Yield blocks of images and of the channels in ``part``, each with padded maps (channels, images, H, W).

    The maps are zero, except where the caller has written values of an earlier block.
    """
    size = padded[0] * padded[1]
    for images in blocks(len(x), max(MAX_VALUES // size, 1)):
        values = (images.stop - images.start) * size
        each = 1 if values >= FILTERED else max(MAX_VALUES // values, 1)
        maps = scratch("maps", (each, images.stop - images.start, *padded), x.dtype)
        maps[...] = 0
        for channels in blocks(part.stop - part.start, each):
            block = slice(part.start + channels.start, part.start + channels.stop)
            yield images, block, maps[: block.stop - block.start]


def _filter(maps: Array, kernel: Array, dilation: tuple[int, ...]) -> Array:
    """Correlate maps (c, n, H, W) with kernels (c, kh, kw): values whose window is inside their map are valid."""
    out = scratch("filtered", maps.shape, maps.dtype)
    c, _, _, W = maps.shape
    if c == 1:
        spread = np.zeros([d * (k - 1) + 1 for d, k in zip(dilation, kernel.shape[1:])], maps.dtype)
        spread[:: dilation[0], :: dilation[1]] = kernel[0]
        flat = maps.reshape(-1, W), out.reshape(-1, W)
        cv2.filter2D(flat[0], -1, spread, dst=flat[1], anchor=(0, 0), borderType=cv2.BORDER_CONSTANT)
        return out
    values, sums = maps.reshape(c, -1), out.reshape(c, -1)
    products = scratch("products", sums.shape, maps.dtype)
    np.multiply(values, kernel[:, 0, :1], out=sums)
    for i, j in np.ndindex(kernel.shape[1:]):
        if i or j:
            shift = i * dilation[0] * W + j * dilation[1]
            length = sums.shape[1] - shift
            np.multiply(values[:, shift:], kernel[:, i, j, None], out=products[:, :length])
            sums[:, :length] += products[:, :length]
    return out


def _windows(maps: Array, g: Geometry) -> Array:
    """View maps (c, n, H, W) as (c, kh, kw, l): the value l places after each element of the kernel."""
    c, n, H, W = maps.shape
    (kh, kw), (down, right), item = g.kernel, g.dilation, maps.itemsize
    length = n * H * W - (kh - 1) * down * W - (kw - 1) * right
    strides = (n * H * W * item, down * W * item, right * item, item)
    return np.ndarray((c, kh, kw, length), maps.dtype, maps, 0, strides)
