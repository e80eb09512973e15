"""Log: the logarithm of a linear function.

bottom[0]  x  any shape
top[0]     y  same shape, may be the same blob

y  = ln(shift + scale x) / ln(base)        NaN or infinite where shift + scale x is not positive, as in Caffe
dx = dy scale / (shift + scale x) / ln(base)

Kept for backward: ``slope`` = dy/dx, because in place y overwrites x.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from netlib.blob import Blobs
from netlib.layer import Layer
from netlib.proto.schema import numbered


@dataclass(frozen=True)
class LogParameter:
    """The ``log_param { ... }`` block."""

    base: float = numbered(1, -1.0)  # -1: e
    scale: float = numbered(2, 1.0)
    shift: float = numbered(3, 0.0)


class Log(Layer):
    """Logarithm of a linear function."""

    param_type = LogParameter
    bottoms = tops = (1, 1)

    def setup(self, bottom: Blobs, top: Blobs) -> None:
        base = self.param.base
        if base != -1 and (base == 1 or not 0 < base < math.inf):
            raise self.fail(f"base {base:g} must be positive, finite and not 1, or -1 for e", "base")
        self.ln_base = 1.0 if base == -1 else math.log(base)

    def reshape(self, bottom: Blobs, top: Blobs) -> None:
        top[0].reshape(bottom[0].shape)

    def forward(self, bottom: Blobs, top: Blobs) -> None:
        p = self.param
        argument = p.shift + p.scale * bottom[0].data
        with np.errstate(divide="ignore", invalid="ignore"):  # the solver reports NaN
            self.slope = p.scale / self.ln_base / argument
            top[0].data[...] = np.log(argument) / self.ln_base

    def backward(self, top: Blobs, propagate_down: list[bool], bottom: Blobs) -> None:
        if propagate_down[0]:
            bottom[0].diff[...] = top[0].diff * self.slope
