"""BNLL: a smooth ReLU ("binomial normal log likelihood"), also called softplus.

bottom[0]  x  any shape
top[0]     y  same shape, may be the same blob

y  = log(1 + exp(x)) = max(x, 0) + log(1 + exp(-|x|))        the second form cannot overflow
dx = dy / (1 + exp(-x))
"""

from __future__ import annotations

import numpy as np

from layers.activation.elementwise import Elementwise, positive, sigmoid
from netlib.blob import Array


class BNLL(Elementwise):
    """Softplus."""

    def _write(self, x: Array, y: Array) -> None:
        np.add(positive(x), np.log1p(np.exp(-np.abs(x))), out=y)

    def _slope(self, x: Array) -> Array:
        return sigmoid(x)
