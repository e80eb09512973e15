"""BNLL: a smooth ReLU ("binomial normal log likelihood"), also called softplus.

bottom[0]  x  any shape
top[0]     y  same shape, may be the same blob

y  = log(1 + exp(x))
dx = dy / (1 + exp(-x))

Kept for backward: ``slope`` = dy/dx, because in place y overwrites x.
"""

from __future__ import annotations

import numpy as np
import scipy

from netlib.blob import Blobs
from netlib.layer import Layer


class BNLL(Layer):
    """Softplus."""

    bottoms = tops = (1, 1)

    def reshape(self, bottom: Blobs, top: Blobs) -> None:
        top[0].reshape(bottom[0].shape)

    def forward(self, bottom: Blobs, top: Blobs) -> None:
        x = bottom[0].data
        self.slope = scipy.special.expit(x)
        top[0].data[...] = np.logaddexp(x, 0)  # without overflow

    def backward(self, top: Blobs, propagate_down: list[bool], bottom: Blobs) -> None:
        if propagate_down[0]:
            bottom[0].diff[...] = top[0].diff * self.slope
