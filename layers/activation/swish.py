"""Swish: a value times its sigmoid, similar to a smooth ReLU.

bottom[0]  x  any shape
top[0]     y  same shape, may be the same blob

y  = x s                       s = 1 / (1 + exp(-beta x))
dx = dy (beta y + s (1 - beta y))

Kept for backward: ``slope`` = dy/dx.
"""

from __future__ import annotations

from dataclasses import dataclass

import scipy

from netlib.blob import Blobs
from netlib.layer import Layer
from netlib.proto.schema import numbered


@dataclass(frozen=True)
class SwishParameter:
    """The ``swish_param { ... }`` block."""

    beta: float = numbered(1, 1.0)  # 0 gives x / 2, large values approach ReLU


class Swish(Layer):
    """Sigmoid-weighted linear unit."""

    param_type = SwishParameter
    bottoms = tops = (1, 1)

    def reshape(self, bottom: Blobs, top: Blobs) -> None:
        top[0].reshape(bottom[0].shape)

    def forward(self, bottom: Blobs, top: Blobs) -> None:
        x, beta = bottom[0].data, self.param.beta
        s = scipy.special.expit(beta * x)
        y = x * s
        self.slope = beta * y + s * (1 - beta * y)
        top[0].data[...] = y

    def backward(self, top: Blobs, propagate_down: list[bool], bottom: Blobs) -> None:
        if propagate_down[0]:
            bottom[0].diff[...] = top[0].diff * self.slope
