"""Exp: raise a base to the power of a linear function.

bottom[0]  x  any shape
top[0]     y  same shape, may be the same blob

y  = base^(shift + scale x)
dx = dy y scale ln(base)
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from layers.activation.elementwise import Elementwise
from netlib.blob import Array, Blobs
from netlib.proto.schema import numbered


@dataclass(frozen=True)
class ExpParameter:
    """The ``exp_param { ... }`` block."""

    base: float = numbered(1, -1.0)  # -1: e
    scale: float = numbered(2, 1.0)
    shift: float = numbered(3, 0.0)


class Exp(Elementwise):
    """Exponential function of a linear function."""

    param: ExpParameter
    reads_bottom, reads_top = False, True

    def setup(self, bottom: Blobs, top: Blobs) -> None:
        base = self.param.base
        if base != -1 and not 0 < base < np.inf:
            raise self.fail(f"base {base:g} must be positive and finite, or -1 for e", "base")
        ln_base = 1.0 if base == -1 else float(np.log(base))
        self.rate, self.offset = ln_base * self.param.scale, ln_base * self.param.shift

    def _write(self, x: Array, y: Array) -> None:
        np.exp(self.rate * x + self.offset, out=y)

    def _slope(self, y: Array) -> Array:
        return self.rate * y
