r"""Depthwise: convolutions in which each group has one channel.

A product with one channel is slow, because it reads as many values as it multiplies. Here the
outputs of all channels are sums of long vectors, one per element of the kernel: the maps of an
image are copied with the channel as last axis (last_axis.py). OpenCV's accumulateProduct multiplies
some rows of them by the element, repeated as often, and adds the product to the outputs, which stay
in the cache. The gradient of x is added to these vectors, and that of w is the sum of their
products with dy.

Large maps are filtered by OpenCV, one channel at a time; with a stride, the windows are
chosen afterwards.

The channels are not divided between threads: the calls take so little time that two threads wait
for the interpreter longer than they save.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import cv2
import numpy as np

from fast.fusing import After
from fast.geometry import MAX_EXCESS, Algorithm, Geometry, Sizes, Sum, check_finite
from fast.last_axis import Maps, map_first, map_last, shape_of
from fast.parallel import scratch
from netlib.blob import Array, blocks

FILTERED = 1200  # values of a map, per window, from which calls of filter2D take less time
FOURIER = 50  # elements of a kernel, from which filter2D uses a Fourier transform of float64
ACTIVATED = 1 << 15  # values of the outputs to which an activation is applied at a time
MAX_VALUES = 1 << 18  # of the maps of a block
MIN_CHANNELS = 32  # of a block
# of the rows of outputs in one call; the weights, nine times as many, stay in the cache
BAND_VALUES = 1 << 14


def is_depthwise(s: Sizes) -> bool:
    """One channel per group of an image. It takes a third to two thirds of the time of Columns."""
    return len(s.sizes) == 2 and s.geometry.group > s.inputs == 1 and s.excess <= MAX_EXCESS


class Filter(Algorithm):
    """OpenCV's filter2D on each map, for large ones."""

    def fits(self, s: Sizes, sum_: Sum) -> bool:
        """Maps of which filter2D computes all windows, with the padding as its border, in less
        time, and not by a Fourier transform, which mixes all values of a map.
        """
        g = s.geometry
        if sum_ != "correlate" or not is_depthwise(s):
            return False
        if set(g.dilation) != {1} or math.prod(g.kernel) >= FOURIER:
            return False
        axes = zip(s.windows, s.sizes, g.stride)
        are_inside = all((o - 1) * step < n for o, n, step in axes)
        are_centred = all(p < k for p, k in zip(g.pad, g.kernel))
        is_large = math.prod(s.sizes) >= FILTERED * math.prod(g.stride)
        return are_inside and are_centred and is_large

    def correlate(self, g: Geometry, x: Array, w: Array, after: After, y: Array) -> None:
        """Write y."""
        C, (w, after) = x.shape[1], after.fold(w)
        if not w.all():
            check_finite(x)  # filter2D omits weights of 0, so that 0 times infinity would be 0
        kernels = _by_input(C, w, 0)
        biases = _biases(w, after).reshape(C, -1)
        _filter(g, x, kernels, biases, after, _by_input(C, y, 1))


class Depthwise(Algorithm):
    """The algorithm for images with one channel per group, and any number of outputs of it."""

    def fits(self, s: Sizes, sum_: Sum) -> bool:
        """One channel per group."""
        return is_depthwise(s)

    def correlate(self, g: Geometry, x: Array, w: Array, after: After, y: Array) -> None:
        """Write y."""
        C, (w, after) = x.shape[1], after.fold(w)
        kernels, target = _by_input(C, w, 0), _by_input(C, y, 1)
        biases = _biases(w, after).reshape(C, -1)
        for c, maps, sums in _blocks(g, x, y):
            for m in range(kernels.shape[1]):
                weights = sums.repeated(kernels[c, m])
                for image, out in zip(x[:, c], target[:, c, m]):
                    maps.read(image)
                    sums.correlate(weights, biases[c, m], after, out)

    def transpose(self, g: Geometry, dy: Array, w: Array, after: After, dx: Array) -> None:
        """Write dx."""
        C = dx.shape[1]
        kernels, gradient = _by_input(C, w, 0), _by_input(C, dy, 1)
        for c, maps, sums in _blocks(g, dx, dy):
            weights = [
                sums.repeated(kernels[c, m], f"kernels {m}") for m in range(kernels.shape[1])
            ]
            for image, out in zip(gradient[:, c], dx[:, c]):
                maps.values[...] = 0
                for m, own in enumerate(weights):
                    sums.transpose(image[:, m], own)
                maps.write(out)
                after.write(out, out, c)

    def gradient(self, g: Geometry, x: Array, dy: Array, dw: Array) -> None:
        """Add to dw."""
        C = x.shape[1]
        total, gradient = _by_input(C, dw, 0), _by_input(C, dy, 1)

        for c, maps, sums in _blocks(g, x, dy):
            for m in range(total.shape[1]):
                found = sums.repeated(np.zeros_like(total[c, m]))
                for image, own in zip(x[:, c], gradient[:, c, m]):
                    maps.read(image)
                    sums.gradient(own, found)
                by_place = found.reshape(*found.shape[:2], -1, len(total[c]))
                total[c, m] += by_place.sum(axis=2).transpose(2, 0, 1)


def _biases(w: Array, after: After) -> Array:
    """The bias (O,) of each output, or zeros."""
    return np.zeros(len(w), w.dtype) if after.bias is None else after.bias


def _filter(g: Geometry, x: Array, kernels: Array, biases: Array, after: After, y: Array) -> None:
    """Write y (N, C, outputs of a channel, Ho, Wo) by OpenCV's filter2D.

    Its result at i is the sum over the window that begins at i - pad, which is the
    output i / stride.
    """
    anchor = g.pad[1], g.pad[0]
    whole = set(g.stride) == {1} and y.shape[3:] == x.shape[2:]
    full = scratch("filtered", x.shape[2:], x.dtype)
    (down, right), (Ho, Wo) = g.stride, y.shape[3:]
    chosen = full[: Ho * down : down, : Wo * right : right]
    each = max(1, ACTIVATED // (y.shape[2] * Ho * Wo))
    for image, outputs in zip(x, y):
        for part in blocks(len(image), each):
            for source, own, added, targets in zip(
                image[part], kernels[part], biases[part].tolist(), outputs[part]
            ):
                for kernel, bias, target in zip(own, added, targets):
                    cv2.filter2D(
                        source,
                        -1,
                        kernel,
                        target if whole else full,
                        anchor,
                        bias,
                        cv2.BORDER_CONSTANT,
                    )
                    if not whole:
                        target[...] = chosen
            after.activate(outputs[part], outputs[part])


def _by_input(channels: int, array: Array, axis: int) -> Array:
    """View an array with an axis of outputs as (..., inputs, outputs of an input, ...)."""
    if axis == 0:  # w (O, 1, kh, kw)
        return array.reshape(channels, len(array) // channels, *array.shape[2:])
    return array.reshape(len(array), channels, array.shape[1] // channels, *array.shape[2:])


class Sums:
    """Sums over the windows of some channels of an image, for some rows of outputs in one call.

    maps  the channels, with their number as last axis
    rows  of outputs in one call
    """

    def __init__(self, maps: Maps) -> None:
        self.maps, (self.high, self.wide), self.channels = maps, maps.outputs, maps.values.shape[-1]
        self.rows = max(1, min(BAND_VALUES // max(self.wide * self.channels, 1), self.high))

    def repeated(self, kernel: Array, key: str = "kernels") -> Array:
        """Each element of kernels (c, kh, kw) for all values of a call, (kh, kw, rows, Wo c)."""
        out = scratch(key, (*kernel.shape[1:], self.rows, self.wide, self.channels), kernel.dtype)
        out[...] = kernel.transpose(1, 2, 0)[:, :, None, None]
        return out.reshape(*kernel.shape[1:], self.rows, -1)

    def _outputs(self) -> Array:
        """Working memory for all outputs, (Ho, Wo, c)."""
        return scratch("filtered", (self.high, self.wide, self.channels), self.maps.values.dtype)

    def _bands(self, outputs: Array) -> Iterator[tuple[slice, Array]]:
        """The rows of outputs of each call, as (rows, Wo c)."""
        by_row = outputs.reshape(self.high, -1)
        for rows in blocks(self.high, self.rows):
            yield rows, by_row[rows]

    def correlate(self, weights: Array, bias: Array, after: After, y: Array) -> None:
        """Write y (c, Ho, Wo) for repeated kernels."""
        out = self._outputs()
        out[...] = bias
        for rows, sums in self._bands(out):
            for element, vectors in self.maps.vectors(rows):
                cv2.accumulateProduct(vectors, weights[element][: len(sums)], sums)
            after.activate(sums, sums)
        map_first(out, y)

    def transpose(self, dy: Array, weights: Array) -> None:
        """Add dy (c, Ho, Wo), times each element of repeated kernels, at the places under it."""
        for rows, gradient in self._bands(self._read(dy)):
            for element, vectors in self.maps.vectors(rows):
                cv2.accumulateProduct(gradient, weights[element][: len(gradient)], vectors)

    def gradient(self, dy: Array, sums: Array) -> None:
        """Add dy (c, Ho, Wo) times the values under each element of the kernel to sums
        (kh, kw, rows, Wo c).
        """
        for rows, gradient in self._bands(self._read(dy)):
            for element, vectors in self.maps.vectors(rows):
                cv2.accumulateProduct(vectors, gradient, sums[element][: len(gradient)])

    def _read(self, dy: Array) -> Array:
        """The gradient dy (c, Ho, Wo) as (Ho, Wo, c)."""
        gradient = self._outputs()
        map_last(dy, gradient)
        return gradient


def _blocks(g: Geometry, x: Array, y: Array) -> Iterator[tuple[slice, Maps, Sums]]:
    """Yield blocks of the channels, each with maps that are zero."""
    sizes = x.shape[2:], y.shape[2:]
    each = max(MAX_VALUES // max(math.prod(shape_of(g, *sizes)), 1), MIN_CHANNELS)
    for own in blocks(x.shape[1], each):
        maps = Maps(g, *sizes, x.swapaxes(0, 1)[own], 0)
        yield own, maps, Sums(maps)
