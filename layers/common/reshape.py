"""Reshape: change the shape without changing the values.

bottom[0]  x  any shape
top[0]     y  ``shape { dim: ... }``: 0 copies the bottom's size of that axis, -1 (once) is inferred

``axis`` and ``num_axes`` limit the change to some axes of x; axis -1 appends after the last.
y = x,  dx = dy, reshaped
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from netlib.blob import Blobs
from netlib.layer import Layer
from netlib.proto.messages import BlobShape
from netlib.proto.schema import numbered


@dataclass(frozen=True)
class ReshapeParameter:
    """The ``reshape_param { ... }`` block."""

    shape: BlobShape = numbered(1, BlobShape())
    axis: int = numbered(2, 0)  # first axis to replace
    num_axes: int = numbered(3, -1)  # number of axes to replace; -1: all from ``axis`` on


class Reshape(Layer):
    """Changes the shape."""

    param: ReshapeParameter
    bottoms = tops = (1, 1)
    in_place = False

    def reshape(self, bottom: Blobs, top: Blobs) -> None:
        x, p = bottom[0], self.param
        axes = len(x.shape)
        first = p.axis if p.axis >= 0 else axes + p.axis + 1
        last = axes if p.num_axes < 0 else first + p.num_axes
        if p.num_axes < -1 or not 0 <= first <= last <= axes:
            raise self.fail(
                f"axis {p.axis}, num_axes {p.num_axes} do not fit a bottom of shape {x.shape}",
                "axis",
            )
        dims = list(p.shape.dim)
        if dims.count(-1) > 1 or min(dims, default=0) < -1:
            raise self.fail(f"shape {dims} may contain one -1 and no smaller number", "shape")
        for i, dim in enumerate(dims):
            if dim == 0:
                if first + i >= axes:
                    raise self.fail(
                        f"shape {dims}: 0 at index {i}, but the bottom has shape {x.shape}", "shape"
                    )
                dims[i] = x.shape[first + i]
        shape = [*x.shape[:first], *dims, *x.shape[last:]]
        if -1 in shape:
            known = math.prod(s for s in shape if s != -1)
            shape[shape.index(-1)] = x.count // known if known else 0
        if math.prod(shape) != x.count:
            raise self.fail(
                f"cannot give {x.count} values {x.shape} the shape {tuple(shape)}", "shape"
            )
        top[0].reshape(shape)

    def forward(self, bottom: Blobs, top: Blobs) -> None:
        top[0].data[...] = bottom[0].data.reshape(top[0].shape)

    def backward(self, top: Blobs, propagate_down: list[bool], bottom: Blobs) -> None:
        if propagate_down[0]:
            bottom[0].diff[...] = top[0].diff.reshape(bottom[0].shape)
