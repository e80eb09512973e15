"""Log: the logarithm of a linear function.

bottom[0]  x  any shape
top[0]     y  same shape, may be the same blob

y  = ln(shift + scale x) / ln(base)
     NaN or infinite where shift + scale x is not positive, as in Caffe
dx = dy scale / (shift + scale x) / ln(base)
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from layers.activation.elementwise import Elementwise
from netlib.blob import Array, Blobs
from netlib.proto.schema import numbered


@dataclass(frozen=True)
class LogParameter:
    """The ``log_param { ... }`` block."""

    base: float = numbered(1, -1.0)  # -1: e
    scale: float = numbered(2, 1.0)
    shift: float = numbered(3, 0.0)


class Log(Elementwise):
    """Logarithm of a linear function."""

    param: LogParameter

    def setup(self, bottom: Blobs, top: Blobs) -> None:
        base = self.param.base
        if base != -1 and (base == 1 or not 0 < base < math.inf):
            raise self.fail(
                f"base {base:g} must be positive, finite and not 1, or -1 for e", "base"
            )
        self.ln_base = 1.0 if base == -1 else math.log(base)

    def _write(self, x: Array, y: Array) -> None:
        np.divide(np.log(self.param.shift + self.param.scale * x), self.ln_base, out=y)

    def _slope(self, x: Array) -> Array:
        return self.param.scale / self.ln_base / (self.param.shift + self.param.scale * x)
