"""Power: shift, scale, and raise to a power.

bottom[0]  x  any shape
top[0]     y  same shape, may be the same blob

y  = (shift + scale x)^power
dx = dy power scale (shift + scale x)^(power - 1)

Kept for backward: ``slope`` = dy/dx, because in place x is gone by then.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from netlib.blob import Blobs
from netlib.layer import Layer


@dataclass(frozen=True)
class PowerParameter:
    """The ``power_param { ... }`` block."""

    power: float = 1.0
    scale: float = 1.0
    shift: float = 0.0


class Power(Layer):
    """Power function of a linear function."""

    param_type = PowerParameter
    bottoms = tops = (1, 1)

    def reshape(self, bottom: Blobs, top: Blobs) -> None:
        top[0].reshape(bottom[0].shape)
        if self.param.power != 1:
            self.slope = np.empty(bottom[0].shape, self.dtype)

    def forward(self, bottom: Blobs, top: Blobs) -> None:
        p, y = self.param, top[0].data
        np.multiply(bottom[0].data, self.dtype.type(p.scale), out=y)
        y += self.dtype.type(p.shift)
        if p.power != 1:
            with np.errstate(divide="ignore", invalid="ignore"):  # a NaN that follows is found by the solver
                slope = p.power * p.scale
                self.slope[...] = slope * y ** self.dtype.type(p.power - 1) if slope else 0
                np.power(y, self.dtype.type(p.power), out=y)

    def backward(self, top: Blobs, propagate_down: list[bool], bottom: Blobs) -> None:
        if propagate_down[0]:
            slope = self.dtype.type(self.param.scale) if self.param.power == 1 else self.slope
            bottom[0].diff[...] = top[0].diff * slope
