"""EuclideanLoss: half the squared distance, averaged over items.

bottom[0]  a  (N, ...)
bottom[1]  b  same number of items and of values per item
top[0]     L  scalar

L  = 1 / (2 N) sum of (a - b)²
da =  dL (a - b) / N
db = -dL (a - b) / N

dL, the diff of the top, is the loss weight. Kept for backward: ``difference`` = a - b.
"""

from __future__ import annotations

from layers.loss.labels import items_and_values
from netlib.blob import Blobs
from netlib.layer import Layer


class EuclideanLoss(Layer):
    """Sum of squared differences over 2 N."""

    bottoms = (2, 2)
    tops = (1, 1)
    in_place = False
    default_loss_weight = 1.0

    def reshape(self, bottom: Blobs, top: Blobs) -> None:
        self.items, self.values = items_and_values(self, bottom)
        top[0].reshape(())

    def forward(self, bottom: Blobs, top: Blobs) -> None:
        a, b = (x.data.reshape(self.items, self.values) for x in bottom)
        self.difference = a - b
        top[0].data[...] = (self.difference**2).sum() / (2 * self.items)

    def backward(self, top: Blobs, propagate_down: list[bool], bottom: Blobs) -> None:
        for x, down, sign in zip(bottom, propagate_down, (1, -1)):
            if down:
                x.diff[...] = (sign * top[0].diff / self.items * self.difference).reshape(x.shape)
