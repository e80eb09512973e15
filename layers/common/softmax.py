"""Softmax: convert scores to probabilities along an axis.

bottom[0]  x  any shape
top[0]     y  same shape, may be the same blob

y  = exp(x) / sum of exp(x) along ``axis``
dx = y (dy - sum of y dy along ``axis``)
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy

from netlib.blob import Blobs
from netlib.layer import Layer
from netlib.proto.schema import Engine, numbered


@dataclass(frozen=True)
class SoftmaxParameter:
    """The ``softmax_param { ... }`` block."""

    axis: int = numbered(2, 1)
    engine: Engine = numbered(1, "DEFAULT")  # accepted, ignored


class Softmax(Layer):
    """Softmax function."""

    param_type = SoftmaxParameter
    bottoms = tops = (1, 1)
    reads_top = True

    def reshape(self, bottom: Blobs, top: Blobs) -> None:
        self.axis = self.canonical_axis(self.param.axis, bottom[0])
        top[0].reshape(bottom[0].shape)

    def forward(self, bottom: Blobs, top: Blobs) -> None:
        top[0].data[...] = scipy.special.softmax(bottom[0].data, axis=self.axis)

    def backward(self, top: Blobs, propagate_down: list[bool], bottom: Blobs) -> None:
        if propagate_down[0]:
            y, dy = top[0].data, top[0].diff
            np.multiply(y, dy - (y * dy).sum(axis=self.axis, keepdims=True), out=bottom[0].diff)
