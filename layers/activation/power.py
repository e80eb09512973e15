"""Power: shift, scale, and raise to a power.

bottom[0]  x  any shape
top[0]     y  same shape, may be the same blob

y  = (shift + scale x)^power
dx = dy power scale (shift + scale x)^(power - 1)
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from layers.activation.elementwise import Elementwise
from netlib.blob import Array, Blobs
from netlib.proto.schema import numbered


@dataclass(frozen=True)
class PowerParameter:
    """The ``power_param { ... }`` block."""

    power: float = numbered(1, 1.0)
    scale: float = numbered(2, 1.0)
    shift: float = numbered(3, 0.0)


class Power(Elementwise):
    """Power function of a linear function."""

    param: PowerParameter

    def setup(self, bottom: Blobs, top: Blobs) -> None:
        self.reads_bottom = self.param.power != 1

    def _write(self, x: Array, y: Array) -> None:
        p = self.param
        y[...] = (p.shift + p.scale * x) ** p.power

    def _slope(self, x: Array) -> Array:
        p = self.param
        if p.power == 1 or p.power * p.scale == 0:
            return np.full_like(x, p.power * p.scale)
        return p.power * p.scale * (p.shift + p.scale * x) ** (p.power - 1)
