"""Exp: raise a base to the power of a linear function.

bottom[0]  x  any shape
top[0]     y  same shape, may be the same blob

y  = base^(shift + scale x)
dx = dy y scale ln(base)

Kept for backward: ``slope`` = dy/dx.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from netlib.blob import Blobs
from netlib.layer import Layer
from netlib.proto.schema import numbered


@dataclass(frozen=True)
class ExpParameter:
    """The ``exp_param { ... }`` block."""

    base: float = numbered(1, -1.0)  # -1: e
    scale: float = numbered(2, 1.0)
    shift: float = numbered(3, 0.0)


class Exp(Layer):
    """Exponential function of a linear function."""

    param_type = ExpParameter
    bottoms = tops = (1, 1)

    def setup(self, bottom: Blobs, top: Blobs) -> None:
        base = self.param.base
        if base != -1 and not 0 < base < math.inf:
            raise self.fail(f"base {base:g} must be positive and finite, or -1 for e", "base")
        self.ln_base = 1.0 if base == -1 else math.log(base)

    def reshape(self, bottom: Blobs, top: Blobs) -> None:
        top[0].reshape(bottom[0].shape)

    def forward(self, bottom: Blobs, top: Blobs) -> None:
        p = self.param
        with np.errstate(over="ignore"):  # the solver reports infinities
            y = np.exp(self.ln_base * (p.shift + p.scale * bottom[0].data))
            self.slope = self.ln_base * p.scale * y
        top[0].data[...] = y

    def backward(self, top: Blobs, propagate_down: list[bool], bottom: Blobs) -> None:
        if propagate_down[0]:
            bottom[0].diff[...] = top[0].diff * self.slope
