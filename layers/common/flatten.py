"""Flatten: join several axes into one.

bottom[0]  x  any shape
top[0]     y  axes ``axis`` to ``end_axis`` (inclusive) joined, by default all but the first; if
              ``end_axis`` is the axis before ``axis``, an axis of size 1 is inserted instead

y = x,  dx = dy, reshaped
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from netlib.blob import Blobs
from netlib.layer import Layer
from netlib.proto.schema import numbered


@dataclass(frozen=True)
class FlattenParameter:
    """The ``flatten_param { ... }`` block."""

    axis: int = numbered(1, 1)
    end_axis: int = numbered(2, -1)


class Flatten(Layer):
    """Joins axes."""

    param: FlattenParameter
    bottoms = tops = (1, 1)
    in_place = False

    def reshape(self, bottom: Blobs, top: Blobs) -> None:
        x = bottom[0]
        first = self.canonical_axis(self.param.axis, x)
        last = self.canonical_axis(self.param.end_axis, x, "end_axis")
        if last < first - 1:
            raise self.fail(
                f"end_axis {self.param.end_axis} comes before axis {self.param.axis}", "end_axis"
            )
        joined = math.prod(x.shape[first : last + 1])
        top[0].reshape(*x.shape[:first], joined, *x.shape[last + 1 :])

    def forward(self, bottom: Blobs, top: Blobs) -> None:
        top[0].data[...] = bottom[0].data.reshape(top[0].shape)

    def backward(self, top: Blobs, propagate_down: list[bool], bottom: Blobs) -> None:
        if propagate_down[0]:
            bottom[0].diff[...] = top[0].diff.reshape(bottom[0].shape)
