"""Slice: split a blob along an axis.

bottom[0]  x    any shape
top[i]     y_i  the parts between the ``slice_point``s, of which the last may be empty; by
                default equal parts

dx = the dy_i in sequence
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from netlib.blob import Blobs
from netlib.layer import Layer
from netlib.proto import schema
from netlib.proto.schema import UInt, numbered


@dataclass(frozen=True)
class SliceParameter:
    """The ``slice_param { ... }`` block."""

    axis: int = numbered(3, 1)
    slice_point: tuple[UInt, ...] = numbered(2, ())
    slice_dim: UInt | None = numbered(1, None)  # older name of axis


class Slice(Layer):
    """Splits a blob into several."""

    param: SliceParameter
    bottoms = (1, 1)
    tops = (1, None)
    in_place = False

    def setup(self, bottom: Blobs, top: Blobs) -> None:
        if self.param.slice_dim is not None and schema.is_given(self.param, "axis"):
            raise self.fail(
                "axis and slice_dim are the same option; expected only one of them", "slice_dim"
            )

    def reshape(self, bottom: Blobs, top: Blobs) -> None:
        p, x = self.param, bottom[0]
        axis = self.axis = self.canonical_axis(p.axis if p.slice_dim is None else p.slice_dim, x)
        size = x.shape[axis]
        equal = size // len(top)
        if not p.slice_point and size % len(top):
            raise self.fail(f"axis {axis} of {x.shape} cannot be split into {len(top)} equal parts")
        self.points = list(p.slice_point) or [equal * i for i in range(1, len(top))]
        ends = [0, *self.points, size]
        sizes = np.diff(ends)
        if p.slice_point:
            is_increasing = min(sizes[:-1]) >= 1 and sizes[-1] >= 0
            if len(sizes) != len(top) or not is_increasing or len(top) > size:
                raise self.fail(
                    f"slice_point {self.points} must be {len(top) - 1} increasing numbers "
                    f"from 1 to {size}, and {len(top)} tops at most {size}",
                    "slice_point",
                )
        for y, a, b in zip(top, ends, ends[1:]):
            y.reshape(*x.shape[:axis], b - a, *x.shape[axis + 1 :])

    def forward(self, bottom: Blobs, top: Blobs) -> None:
        for y, part in zip(top, np.split(bottom[0].data, self.points, axis=self.axis)):
            y.data[...] = part

    def backward(self, top: Blobs, propagate_down: list[bool], bottom: Blobs) -> None:
        if propagate_down[0]:
            for y, part in zip(top, np.split(bottom[0].diff, self.points, axis=self.axis)):
                part[...] = y.diff
