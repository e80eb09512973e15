"""Slice: cut a blob along an axis.

bottom[0]  x    any shape
top[i]     y_i  the parts between the ``slice_point``s; without them, equal parts

dx = the dy_i one after the other
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from netlib.blob import Array, Blobs
from netlib.layer import Layer
from netlib.schema import UInt


@dataclass(frozen=True)
class SliceParameter:
    """The ``slice_param { ... }`` block."""

    axis: int = 1
    slice_point: tuple[UInt, ...] = ()
    slice_dim: UInt | None = None  # older name of axis


class Slice(Layer):
    """Cut a blob into several."""

    param_type = SliceParameter
    bottoms = (1, 1)
    tops = (1, None)
    in_place = False

    def reshape(self, bottom: Blobs, top: Blobs) -> None:
        p, x = self.param, bottom[0]
        self.axis = self.canonical_axis(p.axis if p.slice_dim is None else p.slice_dim, x)
        size = x.shape[self.axis]
        points = list(p.slice_point)
        if not points:
            if size % len(top):
                raise self.fail(f"axis {self.axis} of {x.shape} cannot be cut into {len(top)} equal parts")
            points = [size // len(top) * i for i in range(1, len(top))]
        ends = [0, *points, size]
        if len(points) != len(top) - 1 or min(np.diff(ends)) < 1:
            raise self.fail(
                f"slice_point {points} must be {len(top) - 1} increasing numbers between 0 and {size}", "slice_point"
            )
        self.points = points
        for y, a, b in zip(top, ends, ends[1:]):
            y.reshape(*x.shape[: self.axis], b - a, *x.shape[self.axis + 1 :])

    def forward(self, bottom: Blobs, top: Blobs) -> None:
        for y, part in zip(top, self._parts(bottom[0].data)):
            y.data[...] = part

    def backward(self, top: Blobs, propagate_down: list[bool], bottom: Blobs) -> None:
        if propagate_down[0]:
            for y, part in zip(top, self._parts(bottom[0].diff)):
                part[...] = y.diff

    def _parts(self, array: Array) -> list[Array]:
        return np.split(array, self.points, axis=self.axis)
