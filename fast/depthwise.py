r"""Depthwise: convolutions in which each group has one channel.

A product with one channel is slow, because it reads as many values as it multiplies. With stride 1, large maps are
filtered by OpenCV, which reads each value once; small maps are computed by Columns. With a stride the outputs of many
channels are a weighted sum of long vectors, one per element of the kernel: the padded maps are adjacent in memory, so a
shift by rows and columns is one number. They are first split by the remainders of rows and columns, so that the values
of a vector are adjacent.

The gradient of x adds to these vectors instead of reading them, and that of w are their products with dy.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import cv2
import numpy as np

from fast.columns import Columns
from fast.geometry import Geometry, at, run_parts
from fast.parallel import scratch
from netlib.blob import Array
from netlib.system.memory import blocks

ALL = slice(None)
FILTERED = 1000  # values of the padded maps of a channel from which calls of OpenCV take less time than sums of vectors
MAX_VALUES = 1 << 17  # of the maps of a block
VALUE = 20  # multiplications in a product that take as long as one in a depthwise convolution


class Depthwise:
    """The algorithm for images with one channel per group, and any number of outputs of it."""

    def correlate(self, g: Geometry, x: Array, w: Array, bias: Array | None, y: Array) -> None:
        """Write y."""
        C = x.shape[1]
        kernels, target = _by_input(C, w, 0), _by_input(C, y, 1)
        biases = np.zeros(len(w), w.dtype) if bias is None else bias
        biases = biases.reshape(C, -1)
        size = math.prod(g.padded(x.shape[2:]))
        compute = _sum
        if set(g.stride) == {1}:
            if min(len(x), max(MAX_VALUES // size, 1)) * size < FILTERED:
                Columns().correlate(g, x, w, bias, y)
                return
            compute = _filter

        def job(part: slice) -> None:
            compute(g, x[:, part], kernels[part], biases[part], target[:, part])

        run_parts(job, C, C, y.size * w[0].size * VALUE)

    def transpose(self, g: Geometry, dy: Array, w: Array, bias: Array | None, dx: Array) -> None:
        """Write dx."""
        C = dx.shape[1]
        if g.is_turnable(dx.shape, dy.shape) and len(w) == C:
            self.correlate(g.turned, dy, w[:, :, ::-1, ::-1], bias, dx)
            return
        kernels, gradient = _by_input(C, w, 0), _by_input(C, dy, 1)

        def job(part: slice) -> None:
            for images, channels, maps in _blocks(g, dx, dy, part):
                maps.values[...] = 0
                for m in range(kernels.shape[1]):
                    maps.transpose(gradient[images, channels, m], kernels[channels, m])
                maps.write(dx[images, channels], None if bias is None else bias[channels])

        run_parts(job, C, C, dy.size * w[0].size * VALUE)

    def gradient(self, g: Geometry, x: Array, dy: Array, dw: Array) -> None:
        """Add to dw."""
        C = x.shape[1]
        total, gradient = _by_input(C, dw, 0), _by_input(C, dy, 1)

        def job(part: slice) -> None:
            for images, channels, maps in _blocks(g, x, dy, part):
                maps.read(x[images, channels])
                for m in range(total.shape[1]):
                    maps.gradient(gradient[images, channels, m], total[channels, m])

        run_parts(job, C, C, dy.size * dw[0].size * VALUE)


def _filter(g: Geometry, x: Array, kernels: Array, biases: Array, y: Array) -> None:
    """Write y (N, C, outputs of a channel, Ho, Wo) by OpenCV's filter2D, whose windows start at each value."""
    (N, C, H, W), Wp = x.shape, x.shape[3] + 2 * g.pad[1]
    extent = [d * (k - 1) + 1 for d, k in zip(g.dilation, g.kernel)]
    spread = np.zeros((*kernels.shape[:2], *extent), x.dtype)
    spread[:, :, :: g.dilation[0], :: g.dilation[1]] = kernels
    for images in blocks(N, max(MAX_VALUES // (H * W), 1)):
        n = images.stop - images.start
        padded = scratch("maps", (n, *g.padded((H, W))), x.dtype)
        out = scratch("filtered", padded.shape, x.dtype)
        padded[...] = 0
        inside, valid = padded[at(ALL, g.inside((H, W)))[1:]], out[:, : y.shape[3], : y.shape[4]]
        source, target = padded.reshape(-1, Wp), out.reshape(-1, Wp)
        for c in range(C):
            inside[...] = x[images, c]
            for m in range(kernels.shape[1]):
                cv2.filter2D(source, -1, spread[c, m], target, (0, 0), 0, cv2.BORDER_CONSTANT)
                np.add(valid, biases[c, m], out=y[images, c, m])


def _sum(g: Geometry, x: Array, kernels: Array, biases: Array, y: Array) -> None:
    """Write y (N, C, outputs of a channel, Ho, Wo) as sums of vectors."""
    for images, channels, maps in _blocks(g, x, y[:, :, 0], slice(0, x.shape[1])):
        maps.read(x[images, channels])
        for m in range(kernels.shape[1]):
            found = maps.correlate(kernels[channels, m], y.shape[3:])
            np.add(found, biases[channels, m, None, None, None], out=y[images, channels, m].swapaxes(0, 1))


def _by_input(channels: int, array: Array, axis: int) -> Array:
    """View an array with an axis of outputs as (..., inputs, outputs of an input, ...)."""
    if axis == 0:  # w (O, 1, kh, kw)
        return array.reshape(channels, len(array) // channels, *array.shape[2:])
    return array.reshape(len(array), channels, array.shape[1] // channels, *array.shape[2:])


class Maps:
    """The padded maps of some channels and images, split by the stride.

    values  (sh, sw, c, n, H, W)  row r, column v of a padded map is at [r % sh, v % sw, ..., r // sh, v // sw]
    """

    def __init__(self, g: Geometry, channels: int, images: int, sizes: tuple[int, ...], x: Array) -> None:
        self.g = g
        self.values = scratch("maps", (*g.stride, channels, images, *sizes), x.dtype)
        self.values[...] = 0
        self.length = images * sizes[0] * sizes[1]

    def part(self, channels: int) -> Maps:
        """The first channels of these maps."""
        other = object.__new__(Maps)
        other.g, other.values, other.length = self.g, self.values[:, :, :channels], self.length
        return other

    def _phases(self, x: Array) -> Iterator[tuple[Array, Array]]:
        """For each remainder, the values of x (n, c, H, W) as (c, n, ...), and their places."""
        (sh, sw), (top, left) = self.g.stride, self.g.pad
        by_channel = x.swapaxes(0, 1)
        for r, v in np.ndindex(sh, sw):
            inside = by_channel[:, :, (r - top) % sh :: sh, (v - left) % sw :: sw]
            first, second = -(-(top - r) // sh), -(-(left - v) // sw)
            rows, columns = slice(first, first + inside.shape[2]), slice(second, second + inside.shape[3])
            yield inside, self.values[r, v, :, :, rows, columns]

    def read(self, x: Array) -> None:
        """Copy x (n, c, H, W) to the maps."""
        for inside, places in self._phases(x):
            places[...] = inside

    def write(self, x: Array, bias: Array | None) -> None:
        """Copy the maps to x (n, c, H, W)."""
        for inside, places in self._phases(x):
            if bias is None:
                inside[...] = places
            else:
                np.add(places, bias[:, None, None, None], out=inside)

    def _vectors(self) -> Iterator[tuple[tuple[int, int], Array]]:
        """For each element of the kernel, the values (c, l) under it in all windows."""
        W = self.values.shape[-1]
        for i, j in np.ndindex(*self.g.kernel):
            (row, r), (column, v) = (divmod(n * d, s) for n, d, s in zip((i, j), self.g.dilation, self.g.stride))
            flat = self.values[r, v].reshape(-1, self.length)
            yield (i, j), flat[:, row * W + column :]

    def correlate(self, kernel: Array, outputs: tuple[int, ...]) -> Array:
        """The outputs (c, n, Ho, Wo) for kernels (c, kh, kw)."""
        c, n, H, W = self.values.shape[2:]
        out = scratch("filtered", (c, n, H, W), self.values.dtype)
        valid = out[:, :, : outputs[0], : outputs[1]]
        sums = out.reshape(c, -1)
        products = scratch("products", sums.shape, out.dtype)
        for (i, j), vector in self._vectors():
            length = vector.shape[1]
            weights = kernel[:, i, j, None]
            if i == j == 0:
                np.multiply(vector, weights, out=sums)
            else:
                np.multiply(vector, weights, out=products[:, :length])
                sums[:, :length] += products[:, :length]
        return valid

    def _spread(self, dy: Array) -> Array:
        """Dy (n, c, Ho, Wo) in maps, (c, l)."""
        spread = scratch("filtered", self.values.shape[2:], dy.dtype)
        spread[...] = 0
        spread[:, :, : dy.shape[2], : dy.shape[3]] = dy.swapaxes(0, 1)
        return spread.reshape(-1, self.length)

    def transpose(self, dy: Array, kernel: Array) -> None:
        """Add dy (n, c, Ho, Wo), times each element of kernels (c, kh, kw), at the places under it."""
        spread = self._spread(dy)
        products = scratch("products", spread.shape, dy.dtype)
        for (i, j), vector in self._vectors():
            length = vector.shape[1]
            np.multiply(spread[:, :length], kernel[:, i, j, None], out=products[:, :length])
            vector += products[:, :length]

    def gradient(self, dy: Array, dw: Array) -> None:
        """Add the sums of dy (n, c, Ho, Wo) times the values under each element of the kernel to dw (c, kh, kw)."""
        spread = self._spread(dy)
        for (i, j), vector in self._vectors():
            dw[:, i, j] += np.einsum("cl,cl->c", vector, spread[:, : vector.shape[1]])


def _blocks(g: Geometry, x: Array, y: Array, part: slice) -> Iterator[tuple[slice, slice, Maps]]:
    """Yield blocks of images and of the channels in ``part``, each with maps.

    The padding of the maps is zero, and other places have values of earlier blocks.
    """
    reach = (d * (k - 1) // s for d, k, s in zip(g.dilation, g.kernel, g.stride))
    sizes = tuple(n + r for n, r in zip(y.shape[2:], reach))
    inside = tuple(-(-n // s) for n, s in zip(g.padded(x.shape[2:]), g.stride))
    sizes = tuple(max(n, m) for n, m in zip(sizes, inside))
    size = sizes[0] * sizes[1]
    for images in blocks(len(x), max(MAX_VALUES // size, 1)):
        values = (images.stop - images.start) * size
        each = max(MAX_VALUES // values, 1)
        maps = Maps(g, min(each, part.stop - part.start), images.stop - images.start, sizes, x)
        for block in blocks(part.stop - part.start, each):
            yield images, slice(part.start + block.start, part.start + block.stop), maps.part(block.stop - block.start)
