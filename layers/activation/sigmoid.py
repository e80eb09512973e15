"""Sigmoid: logistic function, with values in (0, 1).

bottom[0]  x  any shape
top[0]     y  same shape, may be the same blob

y  = 1 / (1 + exp(-x)) = (1 + tanh(x / 2)) / 2        Caffe computes the second form
dx = dy y (1 - y)
"""

from __future__ import annotations

from dataclasses import dataclass

from layers.activation.elementwise import Elementwise, sigmoid
from netlib.blob import Array
from netlib.proto.schema import Engine, numbered


@dataclass(frozen=True)
class SigmoidParameter:
    """The ``sigmoid_param { ... }`` block."""

    engine: Engine = numbered(1, "DEFAULT")  # accepted, ignored


class Sigmoid(Elementwise):
    """Logistic function."""

    param: SigmoidParameter
    elementwise = True
    reads_bottom, reads_top = False, True

    def _write(self, x: Array, y: Array) -> None:
        sigmoid(x, out=y)

    def _slope(self, y: Array) -> Array:
        return y * (1 - y)
