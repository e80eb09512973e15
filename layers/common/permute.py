"""Permute: put the axes in another order (SSD).

bottom[0]  x  any shape
top[0]     y  axis i of y is axis order[i] of x; axes that ``order`` does not name follow in
              their sequence

y = x with its axes in this order;  dx = dy with its axes in the inverse order

With ``order: 0 order: 2 order: 3 order: 1``, y[n, h, w, c] = x[n, c, h, w]: all numbers of one
position are neighbours.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from netlib.blob import Blobs
from netlib.layer import Layer
from netlib.proto.schema import UInt, numbered


@dataclass(frozen=True)
class PermuteParameter:
    """The ``permute_param { ... }`` block."""

    order: tuple[UInt, ...] = numbered(1, ())  # the axis of x for each of the first axes of y


class Permute(Layer):
    """Reorders the axes."""

    param: PermuteParameter
    bottoms = tops = (1, 1)
    in_place = False
    reads_bottom = reads_top = False

    def reshape(self, bottom: Blobs, top: Blobs) -> None:
        x, order = bottom[0].shape, self.param.order
        if len(set(order)) < len(order) or max(order, default=-1) >= len(x):
            name = self.spec.bottom[0]
            raise self.fail(
                f"order {list(order)} must name axes of {name!r} {x}, "
                f"0 to {len(x) - 1}, each at most once",
                "order",
            )
        self.axes = (*order, *(axis for axis in range(len(x)) if axis not in order))
        self.batchwise = self.axes[:1] == (0,)
        top[0].reshape([x[axis] for axis in self.axes])

    def forward(self, bottom: Blobs, top: Blobs) -> None:
        top[0].data[...] = bottom[0].data.transpose(self.axes)

    def backward(self, top: Blobs, propagate_down: list[bool], bottom: Blobs) -> None:
        if propagate_down[0]:
            bottom[0].diff[...] = top[0].diff.transpose(np.argsort(self.axes))
