"""Swish: a value times its sigmoid, similar to a smooth ReLU.

bottom[0]  x  any shape
top[0]     y  same shape, may be the same blob

y  = x s                       s = 1 / (1 + exp(-beta x))
dx = dy s (1 + beta x (1 - s))
"""

from __future__ import annotations

from dataclasses import dataclass

from layers.activation.elementwise import Elementwise, sigmoid
from netlib.blob import Array
from netlib.proto.schema import numbered


@dataclass(frozen=True)
class SwishParameter:
    """The ``swish_param { ... }`` block."""

    beta: float = numbered(1, 1.0)  # 0 gives x / 2, large values approach ReLU


class Swish(Elementwise):
    """Sigmoid-weighted linear unit."""

    param_type = SwishParameter

    def _value(self, x: Array) -> Array:
        return x * sigmoid(x, self.param.beta)

    def _slope(self, x: Array) -> Array:
        s, bx = sigmoid(x, self.param.beta), self.param.beta * x
        return s * (1 + bx * (1 - s))
