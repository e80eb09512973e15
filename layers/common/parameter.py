"""Parameter: a learned blob as a top, for layers that read a parameter as a bottom.

params[0]  w  with the shape in ``parameter_param { shape { dim: ... } }``; initially 0
top[0]     y  same shape

y  = w
dw = dy
"""

from __future__ import annotations

from dataclasses import dataclass

from netlib.blob import Blobs
from netlib.fillers import Filler
from netlib.layer import Layer
from netlib.proto.messages import BlobShape
from netlib.proto.schema import numbered


@dataclass(frozen=True)
class ParameterParameter:
    """The ``parameter_param { ... }`` block."""

    shape: BlobShape = numbered(1, BlobShape())  # default: a single number


class Parameter(Layer):
    """A parameter without a computation."""

    param: ParameterParameter
    bottoms = (0, 0)
    tops = (1, 1)

    def setup(self, bottom: Blobs, top: Blobs) -> None:
        shape = self.param.shape.dim
        if min(shape, default=0) < 0:
            raise self.fail(f"shape {shape} has a negative size", "shape")
        self.weight = self.new_param("weight", shape, Filler())

    def reshape(self, bottom: Blobs, top: Blobs) -> None:
        top[0].reshape(self.weight.shape)

    def forward(self, bottom: Blobs, top: Blobs) -> None:
        top[0].data[...] = self.weight.data

    def backward(self, top: Blobs, propagate_down: list[bool], bottom: Blobs) -> None:
        self.weight.diff[...] += top[0].diff
