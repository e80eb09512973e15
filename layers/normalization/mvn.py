"""MVN: normalize each map by its mean and standard deviation ("mean-variance normalization").

bottom[0]  x  (N, C, H, W), or fewer axes
top[0]     y  (N, C, H, W), may be the same blob

y  = (x - m) / s      s = sqrt(v) + eps
dx = (dy - mean of dy - y * mean of (y dy)) / s

The mean m and the variance v are those of each map (H, W), or, with ``across_channels``, of each
item (C, H, W). Without ``normalize_variance``, y = x - m and dx = dy - mean of dy.

As in Caffe, the top always has four axes, and dx is exact only for eps = 0: eps is added outside
the root, only to avoid a division by zero in a constant map. Kept for backward: ``y``, because the
next layer may run in place, and ``s``.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from netlib.blob import Blobs
from netlib.layer import Layer
from netlib.proto.schema import numbered


@dataclass(frozen=True)
class MVNParameter:
    """The ``mvn_param { ... }`` block."""

    normalize_variance: bool = numbered(1, True)  # false: subtract the mean only
    across_channels: bool = numbered(2, False)  # one mean and variance per item instead of per map
    eps: float = numbered(3, 1e-9)


class MVN(Layer):
    """Mean-variance normalization."""

    param: MVNParameter
    bottoms = tops = (1, 1)

    def reshape(self, bottom: Blobs, top: Blobs) -> None:
        x = bottom[0]
        if len(x.shape) > 4 or (len(x.shape) < 4 and top[0] is x):
            allowed = "at most 4 axes, in place 4"
            raise self.fail(
                f"bottom {self.spec.bottom[0]!r} has shape {x.shape}, expected {allowed}"
            )
        if not x.count:
            raise self.fail(f"bottom {self.spec.bottom[0]!r} {x.shape} is empty, so no mean exists")
        top[0].reshape(x.num, x.channels, x.height, x.width)
        self.axes = (1, 2, 3) if self.param.across_channels else (2, 3)

    def forward(self, bottom: Blobs, top: Blobs) -> None:
        x = bottom[0].data.reshape(top[0].shape)
        y = x - x.mean(axis=self.axes, keepdims=True)
        if self.param.normalize_variance:
            v = np.square(y).mean(axis=self.axes, keepdims=True)
            self.s = np.sqrt(v) + self.dtype.type(self.param.eps)
            self.y = y = y / self.s
        top[0].data[...] = y

    def backward(self, top: Blobs, propagate_down: list[bool], bottom: Blobs) -> None:
        if not propagate_down[0]:
            return
        dy = top[0].diff
        dx = dy - dy.mean(axis=self.axes, keepdims=True)
        if self.param.normalize_variance:
            dx = (dx - self.y * (self.y * dy).mean(axis=self.axes, keepdims=True)) / self.s
        bottom[0].diff[...] = dx.reshape(bottom[0].shape)
