"""FastBatchNorm: batch normalization, in TRAIN together with a Scale and a ReLU in place behind it.

In TRAIN, forward has two passes over blocks that stay in the cache. The first computes c = x - k and the sums of c and
c². As k is the mean of the first item, (mean of c)² is at most N times the variance of the batch of N items, and in
practice below it, so the variance is their difference. The second pass computes y, and gain y + bias from it:

    y  = (c - mean of c) / s
    dx = (dy - mean of dy - y mean of (y dy)) gain / s        the Scale has computed the two sums for its own gradients
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from fast.fast_layer import FastLayer
from fast.fusing import after_of, statistics
from fast.parallel import scratch
from fast.per_channel import FastScale, affine, each_block, row_products, row_sums, sums, view
from layers.normalization.batch_norm import BatchNorm
from netlib.blob import Blobs


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
        if self.is_fused:
            return
        C = self.mean.count
        x, out = view(bottom[0].data, 1, C), view(top[0].data, 1, C)
        if self.uses_sums:
            mean, deviation = statistics(self)
            mean, after = mean.astype(x.dtype), after_of(None, self.after)
            factor = (1 / deviation if after.gain is None else after.gain / deviation).astype(x.dtype)
            after = replace(after, gain=factor)

            def scale_and_shift(i: slice, c: slice) -> None:
                own = np.subtract(x[i, c], mean[c, None], out=out[i, c])
                after.write(own, own, c, axis=1)

            each_block(x.shape, scale_and_shift)
            self.s = self._per_channel(deviation)
            return
        self.y = self.kept("y", bottom[0].data)
        y, count = view(self.y, 1, C), x.size // C
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
        self.s, factor, rest = self._per_channel(deviation), (1 / deviation).astype(x.dtype), rest.astype(x.dtype)
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
        if scale:
            factor *= scale.gain.data
        mean, along = (np.asarray(total) * (C / dy.size) for total in (scale.totals if scale else sums(dy, y)))
        mean, along = mean.astype(dy.dtype), along.astype(dy.dtype)

        def job(i: slice, c: slice) -> None:
            part = np.multiply(y[i, c], along[c, None], out=scratch("product", y[i, c].shape, y.dtype))
            part += mean[c, None]
            np.subtract(dy[i, c], part, out=dx[i, c])
            dx[i, c] *= factor[c, None]

        each_block(dy.shape, job)
