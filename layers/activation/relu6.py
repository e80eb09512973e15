"""ReLU6: ReLU that is limited to 6 (MobileNet).

bottom[0]  x  any shape
top[0]     y  same shape, may be the same blob

y  = min(r, 6)         r = x where x > 0, slope x elsewhere
dx = dy where x > 0 and r < 6, slope dy where x <= 0 and r < 6, 0 elsewhere

In place, backward reads y instead of x: the conditions are the same unless the slope is negative.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from netlib.blob import Blobs
from netlib.layer import Layer
from netlib.proto.schema import numbered


@dataclass(frozen=True)
class ReLU6Parameter:
    """The ``relu6_param { ... }`` block."""

    negative_slope: float = numbered(1, 0.0)  # of negative values


class ReLU6(Layer):
    """Rectified linear unit, limited to 6."""

    param_type = ReLU6Parameter
    param_name = "relu6_param"
    bottoms = tops = (1, 1)

    def setup(self, bottom: Blobs, top: Blobs) -> None:
        self.reads_top = bottom[0] is top[0]
        self.slope = self.dtype.type(self.param.negative_slope)
        if self.slope < 0 and bottom[0] is top[0]:
            raise self.fail("a negative negative_slope cannot run in place", "negative_slope")

    def reshape(self, bottom: Blobs, top: Blobs) -> None:
        top[0].reshape(bottom[0].shape)

    def forward(self, bottom: Blobs, top: Blobs) -> None:
        x = bottom[0].data
        top[0].data[...] = np.minimum(np.where(x > 0, x, self.slope * x), 6)

    def backward(self, top: Blobs, propagate_down: list[bool], bottom: Blobs) -> None:
        if propagate_down[0]:
            x, dy = bottom[0].data, top[0].diff
            below = np.where(x > 0, x, self.slope * x) < 6
            bottom[0].diff[...] = np.where(x > 0, dy, self.slope * dy) * below
