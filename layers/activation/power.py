"""Power: shift, scale, and raise to a power.

bottom[0]  x  any shape
top[0]     y  same shape, may be the same blob

y  = (shift + scale x)^power
dx = dy power scale (shift + scale x)^(power - 1)

Kept for backward: ``slope`` = dy/dx, because in place y overwrites x.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from netlib.blob import Blobs
from netlib.layer import Layer
from netlib.proto.schema import numbered


@dataclass(frozen=True)
class PowerParameter:
    """The ``power_param { ... }`` block."""

    power: float = numbered(1, 1.0)
    scale: float = numbered(2, 1.0)
    shift: float = numbered(3, 0.0)


class Power(Layer):
    """Power function of a linear function."""

    param_type = PowerParameter
    bottoms = tops = (1, 1)

    def reshape(self, bottom: Blobs, top: Blobs) -> None:
        top[0].reshape(bottom[0].shape)

    def forward(self, bottom: Blobs, top: Blobs) -> None:
        p = self.param
        base, factor = p.shift + p.scale * bottom[0].data, p.power * p.scale
        with np.errstate(divide="ignore", invalid="ignore"):  # the solver reports NaN
            self.slope = factor * base ** (p.power - 1) if factor else np.zeros_like(base)
            top[0].data[...] = base**p.power

    def backward(self, top: Blobs, propagate_down: list[bool], bottom: Blobs) -> None:
        if propagate_down[0]:
            bottom[0].diff[...] = top[0].diff * self.slope
