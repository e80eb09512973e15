"""EuclideanLoss: half the mean squared distance.

bottom[0]  a  (N, ...)
bottom[1]  b  same number of values, in total and per item
top[0]     L  scalar

L  = 1 / (2 N) sum of (a - b)²
da =  dL (a - b) / N
db = -dL (a - b) / N

dL is the loss weight. Kept for backward: ``difference`` = a - b.
"""

from __future__ import annotations

import numpy as np

from netlib.blob import Blobs
from netlib.layer import Layer


class EuclideanLoss(Layer):
    """Sum of squares over 2N."""

    bottoms = (2, 2)
    tops = (1, 1)
    in_place = False
    loss_weight = 1.0

    def reshape(self, bottom: Blobs, top: Blobs) -> None:
        self.difference = np.empty(self.items_and_values(bottom), self.dtype)
        top[0].reshape(())

    def forward(self, bottom: Blobs, top: Blobs) -> None:
        d = self.difference
        np.subtract(bottom[0].data.reshape(d.shape), bottom[1].data.reshape(d.shape), out=d)
        top[0].data[...] = np.vdot(d, d) / (2 * len(d))

    def backward(self, top: Blobs, propagate_down: list[bool], bottom: Blobs) -> None:
        scale = top[0].diff / self.dtype.type(len(self.difference))
        for x, down, sign in zip(bottom, propagate_down, (1, -1)):
            if down:
                np.multiply(self.difference, sign * scale, out=x.diff.reshape(self.difference.shape))
