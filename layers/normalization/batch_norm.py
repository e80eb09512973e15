"""BatchNorm: normalize each channel by its mean and standard deviation.

bottom[0]  x         (N, C, ...)
params[0]  mean      (C,)  decaying sum of the batches' means; not learned
params[1]  variance  (C,)  decaying sum of the batches' variances; not learned
params[2]  weight    (1,)  decaying number of batches in these sums
top[0]     y         shape of x, may be the same blob

y = (x - m) / s       s = sqrt(v + eps), for each channel

In training, m and v are those of the batch, over all axes but the channels (M values), and they are
added to the sums with the fraction a (``moving_average_fraction``):

    mean <- a mean + m        variance <- a variance + v M / (M - 1)        weight <- a weight + 1

    dx = (dy - mean of dy - y * mean of (y dy)) / s

With ``use_global_stats``, the default in TEST, m = mean / weight and v = variance / weight
(0 if weight is 0); the sums are not changed, and dx = dy / s.

The three parameters are not trained: their lr_mult is 0, and a ``param`` with another value is an
error. Learned gain and bias are in the layer Scale. Kept for backward: ``y``, because the next
layer may run in place, and ``s``.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from netlib.blob import Array, Blobs
from netlib.fillers import Filler
from netlib.layer import TEST, Layer
from netlib.proto import schema
from netlib.proto.messages import ParamSpec
from netlib.proto.schema import numbered


@dataclass(frozen=True)
class BatchNormParameter:
    """The ``batch_norm_param { ... }`` block."""

    # normalize by the sums; by default only in TEST
    use_global_stats: bool | None = numbered(1, None)
    moving_average_fraction: float = numbered(2, 0.999)  # decay of the sums per batch
    eps: float = numbered(3, 1e-5)  # added to the variance to avoid a division by zero


class BatchNorm(Layer):
    """Batch normalization."""

    param: BatchNormParameter
    bottoms = tops = (1, 1)
    reads_bottom = reads_top = False
    moving = True
    rejected_blocks: ClassVar[dict[str, str]] = {
        "bn_param": 'bn_param belongs to the type BN; expected batch_norm_param, or type: "BN"'
    }

    def setup(self, bottom: Blobs, top: Blobs) -> None:
        given = self.param.use_global_stats
        self.uses_sums = self.phase == TEST if given is None else given
        self.batchwise = self.uses_sums
        if len(bottom[0].shape) < 2:
            raise self.fail(
                f"bottom {self.spec.bottom[0]!r} has shape {bottom[0].shape}, expected (N, C, ...)"
            )
        channels = bottom[0].shape[1]
        self.mean = self.new_param("mean", (channels,), Filler())
        self.variance = self.new_param("variance", (channels,), Filler())
        self.weight = self.new_param("weight", (1,), Filler())
        for i, param in enumerate(self.spec.param):
            if param.lr_mult != 0:
                raise self.fail(
                    f"param {i} has lr_mult {param.lr_mult:g}, but statistics are not learned: expected 0"
                )
        frozen = (ParamSpec(lr_mult=0.0),) * (3 - len(self.spec.param))
        self.spec = schema.changed(self.spec, param=self.spec.param + frozen)

    def reshape(self, bottom: Blobs, top: Blobs) -> None:
        channels, shape = self.mean.count, bottom[0].shape
        if len(shape) < 2 or shape[1] != channels:
            raise self.fail(
                f"bottom {self.spec.bottom[0]!r} has shape {shape}, its statistics are of "
                f"{channels} channels: expected (N, {channels}, ...)"
            )
        if bottom[0].count == 0 and not self.uses_sums:
            raise self.fail(
                f"bottom {self.spec.bottom[0]!r} {shape} has no values, so no mean exists"
            )
        self.others = (0, *range(2, len(shape)))  # all axes but the channels
        self.wide = (channels, *(1,) * (len(shape) - 2))  # shape for broadcasting
        top[0].reshape(shape)

    def forward(self, bottom: Blobs, top: Blobs) -> None:
        x = bottom[0].data
        mean, variance, weight = self.mean.data, self.variance.data, self.weight.data
        if self.uses_sums:
            scale = 0 if weight[0] == 0 else 1 / weight[0]
            m, v = scale * mean, scale * variance
            centred = x - self._per_channel(m)
        else:
            m = self._mean(x)
            centred = x - self._per_channel(m)
            centred -= self._per_channel(self._mean(centred))  # removes the rounding error of m
            v = self._mean(np.square(centred))
            self._add_to_sums(m, v, x.size // len(m))
        self.s = self._per_channel(np.sqrt(v + self.param.eps))
        self.y = np.divide(centred, self.s, out=centred)
        top[0].data[...] = self.y

    def _mean(self, x: Array) -> Array:
        """Mean of each channel, (C,).

        NumPy sums each row pairwise; the row sums are added in float64, because float32 would lose
        three digits over many items.
        """
        total = x.sum(axis=self.others[1:]).sum(axis=0, dtype=np.float64)
        return total / (x.size // x.shape[1])

    def _per_channel(self, values: Array) -> Array:
        """Reshape one value per channel, (C,), to broadcast over x, in its dtype."""
        return values.astype(self.dtype).reshape(self.wide)

    def _add_to_sums(self, m: Array, v: Array, values: int) -> None:
        mean, variance, weight = self.mean.data, self.variance.data, self.weight.data
        unbiased = v * (values / max(values - 1, 1))
        for total, new in ((mean, m), (variance, unbiased), (weight, 1)):
            total *= self.param.moving_average_fraction
            total += new

    def backward(self, top: Blobs, propagate_down: list[bool], bottom: Blobs) -> None:
        if not propagate_down[0]:
            return
        dy, y = top[0].diff, self.y
        if self.uses_sums:
            bottom[0].diff[...] = dy / self.s
        else:
            mean, along_y = self._per_channel(self._mean(dy)), self._per_channel(self._mean(dy * y))
            bottom[0].diff[...] = (dy - mean - y * along_y) / self.s
