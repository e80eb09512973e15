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

from layers.activation.elementwise import Elementwise, negative, positive
from netlib.blob import Array, Blobs
from netlib.proto.schema import numbered


@dataclass(frozen=True)
class ReLU6Parameter:
    """The ``relu6_param { ... }`` block."""

    negative_slope: float = numbered(1, 0.0)  # of negative values


class ReLU6(Elementwise):
    """Rectified linear unit, limited to 6."""

    param: ReLU6Parameter
    param_name = "relu6_param"
    elementwise = True
    reads_kept = False

    def setup(self, bottom: Blobs, top: Blobs) -> None:
        self.leak = self.dtype.type(self.param.negative_slope)
        if self.leak < 0 and bottom[0] is top[0]:
            raise self.fail("a negative negative_slope cannot run in place", "negative_slope")

    def reshape(self, bottom: Blobs, top: Blobs) -> None:
        super().reshape(bottom, top)
        self.reads_top = bottom[0] is top[0]

    def _write(self, x: Array, y: Array) -> None:
        if self.leak:
            np.minimum(self._unlimited(x), 6, out=y)
        else:
            x.clip(0, 6, out=y)

    def _slope(self, x: Array) -> Array:
        if not self.leak:
            return (x > 0) & (x < 6)
        return ((x > 0) + self.leak * (x <= 0)) * (self._unlimited(x) < 6)

    def _unlimited(self, x: Array) -> Array:
        return positive(x) + self.leak * negative(x)
