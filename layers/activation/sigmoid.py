"""Sigmoid: logistic function, with values in (0, 1).

bottom[0]  x  any shape
top[0]     y  same shape, may be the same blob

y  = 1 / (1 + exp(-x))
dx = dy y (1 - y)
"""

from __future__ import annotations

from dataclasses import dataclass

import scipy

from netlib.blob import Blobs
from netlib.layer import Layer
from netlib.proto.schema import Engine, numbered


@dataclass(frozen=True)
class SigmoidParameter:
    """The ``sigmoid_param { ... }`` block."""

    engine: Engine = numbered(1, "DEFAULT")  # accepted, ignored


class Sigmoid(Layer):
    """Logistic function."""

    param_type = SigmoidParameter
    bottoms = tops = (1, 1)
    reads_top = True

    def reshape(self, bottom: Blobs, top: Blobs) -> None:
        top[0].reshape(bottom[0].shape)

    def forward(self, bottom: Blobs, top: Blobs) -> None:
        scipy.special.expit(bottom[0].data, out=top[0].data)

    def backward(self, top: Blobs, propagate_down: list[bool], bottom: Blobs) -> None:
        if propagate_down[0]:
            y, dy = top[0].data, top[0].diff
            bottom[0].diff[...] = dy * y * (1 - y)
