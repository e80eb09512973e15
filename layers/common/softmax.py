"""Softmax: convert scores to probabilities along an axis.

bottom[0]  x  any shape
top[0]     y  same shape, may be the same blob

y  = exp(x) / sum of exp(x) along ``axis``
dx = y (dy - sum of y dy along ``axis``)
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from netlib.blob import Array, Blobs, blocks
from netlib.layer import Layer
from netlib.proto.schema import Engine, numbered

# values that stay in the cache; of 2^15 to 2^18 the fastest for 21 classes at 96 x 96 places
BLOCK = 1 << 18


@dataclass(frozen=True)
class SoftmaxParameter:
    """The ``softmax_param { ... }`` block."""

    axis: int = numbered(2, 1)
    engine: Engine = numbered(1, "DEFAULT")  # accepted, ignored


class Softmax(Layer):
    """Softmax function."""

    param: SoftmaxParameter
    bottoms = tops = (1, 1)
    reads_bottom, reads_top = False, True

    def reshape(self, bottom: Blobs, top: Blobs) -> None:
        self.axis = self.canonical_axis(self.param.axis, bottom[0])
        self.batchwise = self.axis > 0
        top[0].reshape(bottom[0].shape)

    def forward(self, bottom: Blobs, top: Blobs) -> None:
        top[0].data[...] = softmax(bottom[0].data, self.axis)

    def backward(self, top: Blobs, propagate_down: list[bool], bottom: Blobs) -> None:
        if propagate_down[0]:
            y, dy = top[0].data, top[0].diff
            np.multiply(y, dy - (y * dy).sum(axis=self.axis, keepdims=True), out=bottom[0].diff)


def softmax(x: Array, axis: int) -> Array:
    """The softmax of x along a non-negative axis, block by block of the other axes."""
    before, after = math.prod(x.shape[:axis]), math.prod(x.shape[axis + 1 :])
    shape = before, x.shape[axis], after
    scores, y = x.reshape(shape), np.empty(shape, x.dtype)
    width = max(BLOCK // max(x.shape[axis], 1), 1)
    for rows in blocks(before, max(width // max(after, 1), 1)):
        for columns in blocks(after, width):
            own = scores[rows, :, columns]
            powers = own - own.max(axis=1, keepdims=True)  # exp of a large score would be infinite
            np.exp(powers, out=powers)
            np.divide(powers, powers.sum(axis=1, keepdims=True), out=y[rows, :, columns])
    return y.reshape(x.shape)
