"""FastScale and FastBatchNorm: one value per channel, in blocks that stay in the cache.

A blob is viewed as (outer, G, inner): G values of the parameter, each for ``inner`` adjacent
values, ``outer`` times. A block is some of the outer items, or some of the G values if there are
few items. Several operations run on one block after the other, on several threads unless the layer
already runs in a slice. Sums are stored per outer item and then added in float64, so they do not
depend on the threads.

Batch normalization is computed in TRAIN together with a Scale and a ReLU in place behind it.
Forward has two passes over the blocks. The first computes c = x - k and the sums of c and c². As k
is the mean of the first item, (mean of c)² is at most N times the variance of the batch of N items,
and in practice below it, so the variance is their difference. The second pass computes y, and gain
y + bias from it:

    y  = (c - mean of c) / s
    dx = (dy - mean of dy - y mean of (y dy)) gain / s
         the Scale has computed the two sums for its own gradients
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np

from fast import parallel
from fast.fast_layer import FastLayer
from fast.fusing import After, after_of, statistics
from fast.parallel import scratch
from layers.activation.scale import Scale
from layers.normalization.batch_norm import BatchNorm
from netlib.blob import Array, Blobs, blocks

# values; in calls on fewer, two threads wait for the interpreter longer than they compute
BLOCK = 1 << 18
MIN_ROW = 64  # values from which BLAS adds a row faster than NumPy


def view(array: Array, axis: int, count: int) -> Array:
    """View an array as (outer, G, inner), with ``count`` values G that start at ``axis``."""
    outer = math.prod(array.shape[:axis])
    return array.reshape(outer, count, array.size // max(outer * count, 1))


def each_block(shape: tuple[int, ...], job: Callable[[slice, slice], None]) -> None:
    """Call ``job`` with slices of the first two axes, about ``BLOCK`` values each, on several
    threads if there are many blocks.
    """
    outer, count, inner = shape
    if outer * count * inner <= BLOCK:
        job(slice(0, outer), slice(0, count))
        return
    each, size = max(1, BLOCK // max(inner * count, 1)), max(1, BLOCK // inner)
    parts = [(rows, own) for rows in blocks(outer, each) for own in blocks(count, size)]
    parallel.run([partial(job, *part) for part in parts])


def affine(x: Array, gain: Array | None, bias: Array | None, y: Array) -> None:
    """Compute y = gain x + bias on arrays (outer, G, inner); gain and bias are (G,) or None."""

    after = After(gain, bias)

    def job(i: slice, c: slice) -> None:
        after.write(x[i, c], y[i, c], c, axis=1)

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
        if not self.learned:
            super().forward(bottom, top)
            return
        x, gain = bottom[0].data, self.gain.data.reshape(-1)
        bias = self.bias.data.reshape(-1) if self.param.bias_term else None
        if self.needs_backward and bottom[0] is top[0]:
            self.x = self.for_backward("x", x)
            self.x[...] = x
        affine(view(x, self.axis, gain.size), gain, bias, view(top[0].data, self.axis, gain.size))

    def backward(self, top: Blobs, propagate_down: list[bool], bottom: Blobs) -> None:
        """Compute the sums for the parameters, and dx = gain dy; a BatchNorm that computes
        forward needs no dx.
        """
        if not self.learned:
            super().backward(top, propagate_down, bottom)
            return
        gain = self.gain.data.reshape(-1)
        dy = view(top[0].diff, self.axis, gain.size)
        x = self.x if bottom[0] is top[0] else bottom[0].data
        assert x is not None
        of_dy, of_product = sums(dy, view(x, self.axis, gain.size))
        assert of_product is not None
        self.totals = of_dy, of_product
        self.gain.diff[...] += of_product.reshape(self.gain.shape)
        if self.param.bias_term:
            self.bias.diff[...] += of_dy.reshape(self.gain.shape)
        if propagate_down[0] and not self.is_fused:
            affine(dy, gain, None, view(bottom[0].diff, self.axis, gain.size))


class FastBatchNorm(FastLayer, BatchNorm):
    """Batch normalization."""

    def fuses_relu(self) -> bool:
        """Forward computes what is behind the layer."""
        return True

    def fuses_channels(self) -> bool:
        """By the sums, also a Scale that has no backward pass."""
        return self.uses_sums

    def fuses_trained_scale(self) -> bool:
        """By the statistics of the batch, also a Scale with a backward pass, which needs y."""
        return not self.uses_sums

    def forward(self, bottom: Blobs, top: Blobs) -> None:
        """Compute y by the sums, or by the statistics of the batch, which are added to the sums."""
        C = self.mean.count
        x, out = view(bottom[0].data, 1, C), view(top[0].data, 1, C)
        if self.uses_sums:
            self._forward_by_sums(x, out)
        else:
            self.y = self.for_backward("y", bottom[0].data)
            self._forward_by_batch(x, view(self.y, 1, C), out)

    def _forward_by_sums(self, x: Array, out: Array) -> None:
        """Write (x - mean) / s and what is behind it, on arrays (N, C, inner)."""
        mean, deviation = statistics(self)
        mean, after = mean.astype(x.dtype), after_of(None, self.after)
        gain = 1.0 if after.gain is None else after.gain
        after = replace(after, gain=(gain / deviation).astype(x.dtype))

        def scale_and_shift(i: slice, c: slice) -> None:
            own = np.subtract(x[i, c], mean[c, None], out=out[i, c])
            after.write(own, own, c, axis=1)

        each_block(x.shape, scale_and_shift)
        self.s = self._per_channel(deviation)

    def _forward_by_batch(self, x: Array, y: Array, out: Array) -> None:
        """Write y and what is behind it, on arrays (N, C, inner), and add to the sums."""
        count = x.size // x.shape[1]
        k = row_sums(x[0]) / x.dtype.type(x.shape[2])
        total = np.empty((2, *x.shape[:2]), x.dtype)

        def centre(i: slice, c: slice) -> None:
            own = np.subtract(x[i, c], k[c, None], out=y[i, c])
            total[0, i, c], total[1, i, c] = row_sums(own), row_products(own, own)

        each_block(x.shape, centre)
        rest, squares = total.sum(axis=1, dtype=np.float64) / count
        v = np.maximum(squares - np.square(rest), 0)
        self._add_to_sums(k + rest, v, count)
        deviation = np.sqrt(v + self.param.eps)
        self.s = self._per_channel(deviation)
        factor, rest = (1 / deviation).astype(x.dtype), rest.astype(x.dtype)
        after = after_of(None, self.after)

        def normalize(i: slice, c: slice) -> None:
            own = np.subtract(y[i, c], rest[c, None], out=y[i, c])
            own *= factor[c, None]
            after.write(own, out[i, c], c, axis=1)

        each_block(x.shape, normalize)
        if scale := self._scale():
            scale.x = self.y

    def _scale(self) -> FastScale | None:
        """The Scale that forward computes, too."""
        return self.after[0] if self.after and isinstance(self.after[0], FastScale) else None

    def backward(self, top: Blobs, propagate_down: list[bool], bottom: Blobs) -> None:
        """Compute dx, or dy / s by the sums."""
        if not propagate_down[0]:
            return
        C = self.mean.count
        dy, dx = view(top[0].diff, 1, C), view(bottom[0].diff, 1, C)
        factor = 1 / self.s.reshape(-1)
        if self.uses_sums:
            affine(dy, factor, None, dx)
            return
        y, scale = view(self.y, 1, C), self._scale()
        totals = scale.totals if scale else sums(dy, y)
        mean, along = (np.asarray(total) * (C / dy.size) for total in totals)
        gain = scale.gain.data.reshape(-1, 1) if scale else None
        if gain is not None:
            mean, along = mean * gain[:, 0], along * gain[:, 0]
        mean, along = mean.astype(dy.dtype), along.astype(dy.dtype)

        def job(i: slice, c: slice) -> None:
            own = dy[i, c]
            if gain is not None:  # in place, as the Scale would
                own *= gain[c]
            part = np.multiply(y[i, c], along[c, None], out=scratch("product", own.shape, y.dtype))
            part += mean[c, None]
            np.subtract(own, part, out=dx[i, c])
            dx[i, c] *= factor[c, None]

        each_block(dy.shape, job)
