"""ReLU: rectified linear unit; replaces negative values by 0.

bottom[0]  x  any shape
top[0]     y  same shape, may be the same blob

y  = x where x > 0, slope x elsewhere
dx = dy where x > 0, slope dy elsewhere (as in Caffe, also at 0)

In place, backward reads y instead of x. The sign is the same unless the slope is negative or
another layer in place has changed it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from netlib.blob import Blobs
from netlib.layer import Layer
from netlib.proto.schema import Engine, numbered


@dataclass(frozen=True)
class ReLUParameter:
    """The ``relu_param { ... }`` block."""

    negative_slope: float = numbered(1, 0.0)  # of negative values; above 0: "leaky" ReLU
    engine: Engine = numbered(2, "DEFAULT")  # accepted, ignored


class ReLU(Layer):
    """Rectified linear unit."""

    param: ReLUParameter
    param_name = "relu_param"
    bottoms = tops = (1, 1)
    elementwise = batchwise = True
    reads_top = reads_kept = False
    keeps_signs = True

    def setup(self, bottom: Blobs, top: Blobs) -> None:
        self.reads_signs = bottom[0] is top[0]
        self.slope = self.dtype.type(self.param.negative_slope)
        if self.slope < 0 and bottom[0] is top[0]:
            raise self.fail("a negative negative_slope cannot run in place", "negative_slope")

    def reshape(self, bottom: Blobs, top: Blobs) -> None:
        top[0].reshape(bottom[0].shape)

    def forward(self, bottom: Blobs, top: Blobs) -> None:
        x = bottom[0].data
        top[0].data[...] = np.where(x > 0, x, self.slope * x)

    def backward(self, top: Blobs, propagate_down: list[bool], bottom: Blobs) -> None:
        if propagate_down[0]:
            x, dy = bottom[0].data, top[0].diff
            bottom[0].diff[...] = np.where(x > 0, dy, self.slope * dy)
