"""ELU: exponential linear unit; positive values pass, negative values saturate at -``alpha``.

bottom[0]  x  any shape
top[0]     y  same shape, may be the same blob

y  = x  where x > 0, alpha (exp(x) - 1) elsewhere
dx = dy where x > 0, dy alpha exp(x)    elsewhere

Kept for backward: ``slope`` = dy/dx, because in place y overwrites x.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from netlib.blob import Blobs
from netlib.layer import Layer
from netlib.proto.schema import numbered


@dataclass(frozen=True)
class ELUParameter:
    """The ``elu_param { ... }`` block."""

    alpha: float = numbered(1, 1.0)  # y tends to -alpha for x towards -infinity


class ELU(Layer):
    """Exponential linear unit."""

    param_type = ELUParameter
    bottoms = tops = (1, 1)

    def reshape(self, bottom: Blobs, top: Blobs) -> None:
        top[0].reshape(bottom[0].shape)

    def forward(self, bottom: Blobs, top: Blobs) -> None:
        x, alpha = bottom[0].data, self.param.alpha
        negative = np.minimum(x, 0)
        self.slope = np.where(x > 0, 1, alpha * np.exp(negative))
        top[0].data[...] = np.maximum(x, 0) + alpha * np.expm1(negative)

    def backward(self, top: Blobs, propagate_down: list[bool], bottom: Blobs) -> None:
        if propagate_down[0]:
            bottom[0].diff[...] = top[0].diff * self.slope
