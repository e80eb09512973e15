"""Swish: a value times its sigmoid, similar to a smooth ReLU.

bottom[0]  x  any shape
top[0]     y  same shape, may be the same blob

y  = x s                       s = 1 / (1 + exp(-beta x))
dx = dy s (1 + beta x (1 - s))
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from layers.activation.elementwise import Elementwise, sigmoid
from netlib.blob import Array
from netlib.proto.schema import numbered


@dataclass(frozen=True)
class SwishParameter:
    """The ``swish_param { ... }`` block."""

    beta: float = numbered(1, 1.0)  # 0 gives x / 2, large values approach ReLU


class Swish(Elementwise):
    """Sigmoid-weighted linear unit."""

    param: SwishParameter

    def _write(self, x: Array, y: Array) -> None:
        np.multiply(x, sigmoid(x, self.param.beta), out=y)

    def _slope(self, x: Array) -> Array:
        half = self.param.beta / 2 * x
        u = np.tanh(half)  # s is (1 + u) / 2, 1 - s is (1 - u) / 2
        return 0.5 * (1 + u) * (1 + half * (1 - u))
