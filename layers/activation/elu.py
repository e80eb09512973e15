"""ELU: exponential linear unit; positive values pass, negative values saturate at -``alpha``.

bottom[0]  x  any shape
top[0]     y  same shape, may be the same blob

y  = x  where x > 0, alpha (exp(x) - 1) elsewhere
dx = dy where x > 0, dy alpha exp(x)    elsewhere
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from layers.activation.elementwise import Elementwise, negative, positive
from netlib.blob import Array
from netlib.proto.schema import numbered


@dataclass(frozen=True)
class ELUParameter:
    """The ``elu_param { ... }`` block."""

    alpha: float = numbered(1, 1.0)  # y tends to -alpha for x towards -infinity


class ELU(Elementwise):
    """Exponential linear unit."""

    param: ELUParameter

    def _write(self, x: Array, y: Array) -> None:
        np.add(positive(x), self.param.alpha * np.expm1(negative(x)), out=y)

    def _slope(self, x: Array) -> Array:
        alpha, slope = self.param.alpha, np.exp(negative(x))
        if alpha == 1:
            return slope
        return slope * ((x > 0) + self.dtype.type(alpha) * (x <= 0))
