"""FastScale, FastBias, FastPReLU and FastBatchNorm: one value per channel, in blocks that stay in the cache.

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
from layers.activation.bias import Bias
from layers.activation.prelu import PReLU
from layers.activation.scale import Scale
from layers.normalization.batch_norm import BatchNorm
from netlib.blob import Array, Blobs
from netlib.system.memory import blocks

BLOCK = 1 << 16  # values
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
        total[0, i, c] = a[i, c].sum(axis=2)
        if b is not None:
            product = np.multiply(a[i, c], b[i, c], out=scratch("product", b[i, c].shape, a.dtype))
            total[1, i, c] = product.sum(axis=2)

    each_block(a.shape, job)
    plain, product = (total[k].sum(axis=0, dtype=np.float64) if k == 0 or b is not None else None for k in range(2))
    assert plain is not None
    return plain, product


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
        """Compute the sums for the parameters, and dx = gain dy."""
        if not self.learned:
            super().backward(top, propagate_down, bottom)
            return
        gain = self.gain.data.reshape(-1)
        dy = view(top[0].diff, self.axis, gain.size)
        x = self.x if bottom[0] is top[0] else bottom[0].data
        of_dy, of_product = sums(dy, view(x, self.axis, gain.size))
        assert of_product is not None
        self.gain.diff[...] += of_product.reshape(self.gain.shape)
        if self.param.bias_term:
            self.bias.diff[...] += of_dy.reshape(self.gain.shape)
        if propagate_down[0]:
            affine(dy, gain, None, view(bottom[0].diff, self.axis, gain.size))


class FastBias(FastLayer, Bias):
    """Bias with a learned parameter. A second bottom is added by the plain layer."""

    def forward(self, bottom: Blobs, top: Blobs) -> None:
        """Compute y = x + b."""
        if not self.learned:
            super().forward(bottom, top)
            return
        b, axis = self.bias.data.reshape(-1), self._axis(bottom)
        affine(view(bottom[0].data, axis, b.size), None, b, view(top[0].data, axis, b.size))

    def backward(self, top: Blobs, propagate_down: list[bool], bottom: Blobs) -> None:
        """Compute db, and copy dy to dx unless they are one array."""
        if not self.learned:
            super().backward(top, propagate_down, bottom)
            return
        dy = top[0].diff
        self.bias.diff[...] += sums(view(dy, self._axis(bottom), self.bias.count))[0].reshape(self.bias.shape)
        if propagate_down[0] and bottom[0] is not top[0]:
            bottom[0].diff[...] = dy

    def _axis(self, bottom: Blobs) -> int:
        return len(bottom[0].shape) - len(self.wide) if self.bias.shape else 0


class FastPReLU(FastLayer, PReLU):
    """Rectified linear unit with learned slopes."""

    def forward(self, bottom: Blobs, top: Blobs) -> None:
        """Compute y = max(x, 0) + slope min(x, 0); in place, x is copied if backward will read it."""
        x, slope = bottom[0].data, self.slope.data.reshape(-1)
        if self.needs_backward and bottom[0] is top[0]:
            self.x = self.kept("x", x)
            self.x[...] = x
        x, y = view(x, self._axis(), slope.size), view(top[0].data, self._axis(), slope.size)

        def job(i: slice, c: slice) -> None:
            negative = np.minimum(x[i, c], 0, out=scratch("product", x[i, c].shape, x.dtype))
            negative *= slope[c, None]
            np.maximum(x[i, c], 0, out=y[i, c])
            y[i, c] += negative

        each_block(x.shape, job)

    def backward(self, top: Blobs, propagate_down: list[bool], bottom: Blobs) -> None:
        """Compute the sums for the slopes, and dx."""
        slope, axis = self.slope.data.reshape(-1), self._axis()
        x = view(self.x if bottom[0] is top[0] else bottom[0].data, axis, slope.size)
        dy = view(top[0].diff, axis, slope.size)
        _, of_product = sums(dy, np.minimum(x, 0))
        assert of_product is not None
        self.slope.diff[...] += of_product.reshape(self.slope.shape)
        if propagate_down[0]:
            dx = view(bottom[0].diff, axis, slope.size)

            def job(i: slice, c: slice) -> None:
                own = dy[i, c]
                dx[i, c] = np.where(x[i, c] > 0, own, slope[c, None] * own)

            each_block(dy.shape, job)

    def _axis(self) -> int:
        return 1 if self.slope.shape else 0


class FastBatchNorm(FastLayer, BatchNorm):
    """Batch normalization: in TEST one operation for each of mean and deviation, in TRAIN three passes."""

    def forward(self, bottom: Blobs, top: Blobs) -> None:
        """Compute y by the sums, or by the statistics of the batch, which are added to the sums."""
        if self.is_fused:
            return
        C = self.mean.count
        x, y = view(bottom[0].data, 1, C), view(top[0].data, 1, C)
        if self.uses_sums:
            mean, deviation = self.statistics()
            self._normalize(x, mean.astype(x.dtype), deviation, y)
            self.s = self._per_channel(deviation)
            return
        count = x.size // C
        m = sums(x)[0] / count
        centred = self.y = self.kept("y", bottom[0].data)
        part = view(centred, 1, C)
        affine(x, None, -m.astype(x.dtype), part)
        rest, squares = sums(part, part)
        assert squares is not None
        rest /= count  # the rounding error of m
        v = np.maximum(squares / count - np.square(rest), 0)
        self._add_to_sums(m, v, count)
        deviation = np.sqrt(v + self.param.eps)
        self._normalize(part, rest.astype(x.dtype), deviation, y, part)
        self.s = self._per_channel(deviation)

    def statistics(self) -> tuple[Array, Array]:
        """Mean and standard deviation of each channel by the sums, (C,)."""
        weight = self.weight.data[0]
        scale = 0 if weight == 0 else 1 / weight
        return scale * self.mean.data, np.sqrt(scale * self.variance.data + self.param.eps)

    def _normalize(self, x: Array, m: Array, deviation: Array, y: Array, copy: Array | None = None) -> None:
        """Compute y = (x - m) / deviation, and write it to ``copy``, too."""
        factor = (1 / deviation).astype(x.dtype)

        def job(i: slice, c: slice) -> None:
            out = y[i, c] if copy is None else copy[i, c]
            np.subtract(x[i, c], m[c, None], out=out)
            out *= factor[c, None]
            if copy is not None:
                y[i, c] = out

        each_block(x.shape, job)

    def backward(self, top: Blobs, propagate_down: list[bool], bottom: Blobs) -> None:
        """Compute dx = (dy - mean of dy - y mean of (y dy)) / s, or dy / s by the sums."""
        if not propagate_down[0]:
            return
        C = self.mean.count
        dy, dx = view(top[0].diff, 1, C), view(bottom[0].diff, 1, C)
        factor = 1 / self.s.reshape(-1)
        if self.uses_sums:
            affine(dy, factor, None, dx)
            return
        y, count = view(self.y, 1, C), dy.size // C
        mean, along = (np.asarray(total) / count for total in sums(dy, y))
        mean, along = mean.astype(dy.dtype), along.astype(dy.dtype)

        def job(i: slice, c: slice) -> None:
            part = np.multiply(y[i, c], along[c, None], out=scratch("product", y[i, c].shape, y.dtype))
            part += mean[c, None]
            np.subtract(dy[i, c], part, out=dx[i, c])
            dx[i, c] *= factor[c, None]

        each_block(dy.shape, job)
