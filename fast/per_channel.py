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

# values of a block; with fewer, two threads wait for the interpreter longer than they compute
BLOCK = 1 << 18
MIN_ROW = 64  # values of a row from which BLAS adds them faster than NumPy


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
    items = blocks(outer, max(1, BLOCK // max(inner * count, 1)))
    channels = blocks(count, max(1, BLOCK // inner))
    parallel.run([partial(job, i, c) for i in items for c in channels])


def affine(x: Array, gain: Array | None, bias: Array | None, y: Array) -> None:
    """Compute y = gain x + bias on arrays (outer, G, inner); gain and bias are (G,) or None."""
    after = After(gain, bias)

    def write(i: slice, c: slice) -> None:
        after.write(x[i, c], y[i, c], c, axis=1)

    each_block(x.shape, write)


def sums(a: Array, b: Array) -> Array:
    """The sums of a and of a b over the other axes of (outer, G, inner): (2, G) in float64."""
    by_item = np.empty((2, *a.shape[:2]), a.dtype)

    def add(i: slice, c: slice) -> None:
        by_item[0, i, c] = row_sums(a[i, c])
        by_item[1, i, c] = row_products(a[i, c], b[i, c])

    each_block(a.shape, add)
    return np.asarray(by_item.sum(axis=1, dtype=np.float64))


def row_sums(a: Array) -> Array:
    """The sums of a over its last axis."""
    inner = a.shape[-1]
    return a @ np.ones(inner, a.dtype) if inner >= MIN_ROW else a.sum(axis=-1)


def row_products(a: Array, b: Array) -> Array:
    """The sums of a b over the last axis."""
    if a.shape[-1] >= MIN_ROW:
        return np.matmul(a[..., None, :], b[..., None])[..., 0, 0]
    products = np.multiply(a, b, out=scratch("product", a.shape, a.dtype))
    return products.sum(axis=-1)


class FastScale(FastLayer, Scale):
    """Scale with learned parameters. A gain from a second bottom is computed by the plain layer."""

    def forward(self, bottom: Blobs, top: Blobs) -> None:
        """Compute y = gain x + bias; in place, x is copied if backward will read it."""
        if not self.learned:
            super().forward(bottom, top)
            return
        x = bottom[0].data
        gain = self.gain.data.reshape(-1)
        bias = self.bias.data.reshape(-1) if self.param.bias_term else None
        if self.needs_backward and bottom[0] is top[0]:
            self.x = self.for_backward("x", x)
            self.x[...] = x
        affine(view(x, self.axis, gain.size), gain, bias, view(top[0].data, self.axis, gain.size))

    def backward(self, top: Blobs, propagate_down: list[bool], bottom: Blobs) -> None:
        """Compute the gradients of the parameters, and dx = gain dy. A BatchNorm that computes
        forward reads ``diff_sums`` and dy in place of dx.

        diff_sums  (2, G) sums of dy and of x dy
        """
        if not self.learned:
            super().backward(top, propagate_down, bottom)
            return
        gain = self.gain.data.reshape(-1)
        dy = view(top[0].diff, self.axis, gain.size)
        x = self.x if bottom[0] is top[0] else bottom[0].data
        assert x is not None
        self.diff_sums = sums(dy, view(x, self.axis, gain.size))
        sum_dy, sum_x_dy = self.diff_sums
        self.gain.diff[...] += sum_x_dy.reshape(self.gain.shape)
        if self.param.bias_term:
            self.bias.diff[...] += sum_dy.reshape(self.gain.shape)
        if propagate_down[0] and not self.is_fused:
            affine(dy, gain, None, view(bottom[0].diff, self.axis, gain.size))

    def take_memory(self) -> None:
        """Copy x, the normalized values of a BatchNorm."""
        shared: Array | None = getattr(self, "x", None)
        if shared is not None:
            self.x = self.for_backward("x", shared)
            self.x[...] = shared


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
        exact_mean, deviation = statistics(self)
        mean = exact_mean.astype(x.dtype)
        after = after_of(None, self.after)
        gain = 1.0 if after.gain is None else after.gain
        after = replace(after, gain=(gain / deviation).astype(x.dtype))

        def scale_and_shift(i: slice, c: slice) -> None:
            centred = np.subtract(x[i, c], mean[c, None], out=out[i, c])
            after.write(centred, centred, c, axis=1)

        each_block(x.shape, scale_and_shift)
        self.s = self._per_channel(deviation)

    def _forward_by_batch(self, x: Array, y: Array, out: Array) -> None:
        """Write y and what is behind it, on arrays (N, C, inner), and add to the sums."""
        count = x.size // x.shape[1]
        k = row_sums(x[0]) / x.dtype.type(x.shape[2])
        by_item = np.empty((2, *x.shape[:2]), x.dtype)

        def centre(i: slice, c: slice) -> None:
            centred = np.subtract(x[i, c], k[c, None], out=y[i, c])
            by_item[0, i, c] = row_sums(centred)
            by_item[1, i, c] = row_products(centred, centred)

        each_block(x.shape, centre)
        mean, mean_square = by_item.sum(axis=1, dtype=np.float64) / count
        variance = np.maximum(mean_square - np.square(mean), 0)
        self._add_to_sums(k + mean, variance, count)
        deviation = np.sqrt(variance + self.param.eps)
        self.s = self._per_channel(deviation)
        factor = (1 / deviation).astype(x.dtype)
        shift = mean.astype(x.dtype)
        after = after_of(None, self.after)

        def normalize(i: slice, c: slice) -> None:
            normalized = np.subtract(y[i, c], shift[c, None], out=y[i, c])
            normalized *= factor[c, None]
            after.write(normalized, out[i, c], c, axis=1)

        each_block(x.shape, normalize)
        if scale := self._fused_scale():
            scale.x = self.y

    def _fused_scale(self) -> FastScale | None:
        """The Scale that forward computes, too."""
        return self.after[0] if self.after and isinstance(self.after[0], FastScale) else None

    def backward(self, top: Blobs, propagate_down: list[bool], bottom: Blobs) -> None:
        """Compute dx, or dy / s by the sums."""
        if not propagate_down[0]:
            return
        C = self.mean.count
        dy, dx = view(top[0].diff, 1, C), view(bottom[0].diff, 1, C)
        if self.uses_sums:
            affine(dy, 1 / self.s.reshape(-1), None, dx)
        else:
            self._backward_by_batch(dy, dx)

    def _backward_by_batch(self, dy: Array, dx: Array) -> None:
        """Write dx, on arrays (N, C, inner). Behind the BatchNorm, dy is first multiplied by the
        gain of a fused Scale, in place, as the Scale would.
        """
        C = self.mean.count
        y = view(self.y, 1, C)
        scale = self._fused_scale()
        means = (scale.diff_sums if scale else sums(dy, y)) * (C / dy.size)
        gain = scale.gain.data.reshape(-1, 1) if scale else None
        if gain is not None:
            means = means * gain[:, 0]
        mean_dy, mean_y_dy = means.astype(dy.dtype)
        factor = 1 / self.s.reshape(-1)

        def subtract_means(i: slice, c: slice) -> None:
            own = dy[i, c]
            if gain is not None:
                own *= gain[c]
            part = scratch("product", own.shape, y.dtype)
            np.multiply(y[i, c], mean_y_dy[c, None], out=part)
            part += mean_dy[c, None]
            np.subtract(own, part, out=dx[i, c])
            dx[i, c] *= factor[c, None]

        each_block(dy.shape, subtract_means)
