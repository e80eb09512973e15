"""FastScale: one value per channel, in blocks that stay in the cache.

A blob is viewed as (outer, G, inner): G values of the parameter, each for ``inner`` adjacent values, ``outer`` times. A
block is some of the outer items, or some of the G values if there are few items. Several operations run on one block
after the other, on several threads unless the layer already runs in a slice. Sums are stored per outer item and then
added in float64, so they do not depend on the threads.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial

import numpy as np

from fast import parallel
from fast.fast_layer import FastLayer
from fast.parallel import scratch
from layers.activation.scale import Scale
from netlib.blob import Array, Blobs
from netlib.system.memory import blocks

BLOCK = 1 << 18  # values; in calls on fewer, two threads wait for the interpreter longer than they compute
MIN_ROW = 64  # values from which BLAS adds a row faster than NumPy
Job = Callable[[slice, slice], None]


def view(array: Array, axis: int, count: int) -> Array:
    """View an array as (outer, G, inner), with ``count`` values G that start at ``axis``."""
    outer = math.prod(array.shape[:axis])
    return array.reshape(outer, count, array.size // max(outer * count, 1))


def each_block(shape: tuple[int, ...], job: Job) -> None:
    """Call ``job`` with slices of the first two axes, about ``BLOCK`` values each, on several threads if there are many
    blocks."""
    outer, count, inner = shape
    if inner * count <= BLOCK:
        parts = [(own, slice(0, count)) for own in blocks(outer, max(1, BLOCK // max(inner * count, 1)))]
    else:
        size = max(1, BLOCK // inner)
        parts = [(slice(i, i + 1), own) for i in range(outer) for own in blocks(count, size)]
    parallel.run([partial(job, *part) for part in parts])


def affine(x: Array, gain: Array | None, bias: Array | None, y: Array) -> None:
    """Compute y = gain x + bias on arrays (outer, G, inner); gain and bias are (G,) or None."""

    def job(i: slice, c: slice) -> None:
        own = x[i, c]
        if gain is not None:
            own = np.multiply(own, gain[c, None], out=y[i, c])
        if bias is not None:
            np.add(own, bias[c, None], out=y[i, c])

    each_block(x.shape, job)


def sums(a: Array, b: Array | None = None) -> tuple[Array, Array | None]:
    """Sums of a, and of a b if given, (G,) in float64, over the other axes of (outer, G, inner)."""
    total = np.empty((2, *a.shape[:2]), a.dtype)

    def job(i: slice, c: slice) -> None:
        total[0, i, c] = row_sums(a[i, c])
        if b is not None:
            total[1, i, c] = row_products(a[i, c], b[i, c])

    each_block(a.shape, job)
    plain = total[0].sum(axis=0, dtype=np.float64)
    return plain, None if b is None else total[1].sum(axis=0, dtype=np.float64)


def row_sums(a: Array) -> Array:
    """The sums of a over its last axis."""
    inner = a.shape[-1]
    return a @ np.ones(inner, a.dtype) if inner >= MIN_ROW else a.sum(axis=-1)


def row_products(a: Array, b: Array) -> Array:
    """The sums of a b over the last axis."""
    if a.shape[-1] >= MIN_ROW:
        return np.matmul(a[..., None, :], b[..., None])[..., 0, 0]
    return np.multiply(a, b, out=scratch("product", a.shape, a.dtype)).sum(axis=-1)


class FastScale(FastLayer, Scale):
    """Scale with learned parameters. A gain from a second bottom is computed by the plain layer."""

    def forward(self, bottom: Blobs, top: Blobs) -> None:
        """Compute y = gain x + bias; in place, x is copied if backward will read it."""
        if self.is_fused:
            return
        if not self.learned:
            super().forward(bottom, top)
            return
        x, gain = bottom[0].data, self.gain.data.reshape(-1)
        bias = self.bias.data.reshape(-1) if self.param.bias_term else None
        if self.needs_backward and bottom[0] is top[0]:
            self.x = self.kept("x", x)
            self.x[...] = x
        affine(view(x, self.axis, gain.size), gain, bias, view(top[0].data, self.axis, gain.size))

    def backward(self, top: Blobs, propagate_down: list[bool], bottom: Blobs) -> None:
        """Compute the sums for the parameters, and dx = gain dy; a BatchNorm that computes forward needs no dx."""
        if not self.learned:
            super().backward(top, propagate_down, bottom)
            return
        gain = self.gain.data.reshape(-1)
        dy = view(top[0].diff, self.axis, gain.size)
        x = self.x if bottom[0] is top[0] else bottom[0].data
        of_dy, of_product = sums(dy, view(x, self.axis, gain.size))
        assert of_product is not None
        self.totals = of_dy, of_product
        self.gain.diff[...] += of_product.reshape(self.gain.shape)
        if self.param.bias_term:
            self.bias.diff[...] += of_dy.reshape(self.gain.shape)
        if propagate_down[0] and not self.is_fused:
            affine(dy, gain, None, view(bottom[0].diff, self.axis, gain.size))
