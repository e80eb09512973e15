# Replace each NotImplementedError, then run: python tools/exercise.py relu
"""ReLU: rectified linear unit; replaces negative values by 0.

bottom[0]  x  any shape
top[0]     y  same shape, may be the same blob

y  = x where x > 0, slope x elsewhere
dx = dy where x > 0, slope dy elsewhere (as in Caffe, also at 0)

In place, backward reads y instead of x. The sign is the same unless the slope is negative or another layer in place has
changed it.
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

    param_type = ReLUParameter
    param_name = "relu_param"
    bottoms = tops = (1, 1)
    keeps_signs = True

    def setup(self, bottom: Blobs, top: Blobs) -> None:
        self.reads_signs = bottom[0] is top[0]
        self.slope = self.dtype.type(self.param.negative_slope)
        if self.slope < 0 and bottom[0] is top[0]:
            raise self.fail("a negative negative_slope cannot run in place", "negative_slope")

    def reshape(self, bottom: Blobs, top: Blobs) -> None:
        # Give top[0] the shape of bottom[0].
        raise NotImplementedError

    def forward(self, bottom: Blobs, top: Blobs) -> None:
        # Read bottom[0].data (x) and write top[0].data (y): x where x > 0, self.slope * x elsewhere. Write into the
        # existing array, top[0].data[...] = ..., and do not change bottom[0].data.
        raise NotImplementedError

    def backward(self, top: Blobs, propagate_down: list[bool], bottom: Blobs) -> None:
        # If propagate_down[0], write every element of bottom[0].diff (dx): top[0].diff (dy) where x > 0, self.slope *
        # dy elsewhere.
        raise NotImplementedError
