"""Reduction: reduce all axes from ``axis`` on to one number.

bottom[0]  x  any shape
top[0]     y  the axes of x before ``axis``; with the default, 0, a single number

SUM    y = c sum of x           dx = c dy
ASUM   y = c sum of |x|         dx = c dy sign(x)      sign(0) = 0
SUMSQ  y = c sum of x²          dx = 2 c dy x
MEAN   y = c/n sum of x         dx = c/n dy            n values per y

with c = ``coeff``. To use it as a loss, set ``loss_weight``.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np

from netlib.blob import Blobs
from netlib.layer import Layer
from netlib.proto.schema import OneBased, numbered


@dataclass(frozen=True)
class ReductionParameter:
    """The ``reduction_param { ... }`` block."""

    operation: OneBased[Literal["SUM", "ASUM", "SUMSQ", "MEAN"]] = numbered(1, "SUM")
    axis: int = numbered(2, 0)  # first reduced axis; all later ones are reduced too
    coeff: float = numbered(3, 1.0)  # c, factor of the result


class Reduction(Layer):
    """Sum, sum of absolute values or of squares, mean."""

    param: ReductionParameter
    bottoms = tops = (1, 1)
    in_place = False

    def reshape(self, bottom: Blobs, top: Blobs) -> None:
        axis = self.canonical_axis(self.param.axis, bottom[0])
        self.reduced = tuple(range(axis, len(bottom[0].shape)))
        self.coeff = self.dtype.type(self.param.coeff)
        if self.param.operation == "MEAN":
            count = math.prod(bottom[0].shape[axis:])
            if count == 0:
                raise self.fail(
                    f"bottom {self.spec.bottom[0]!r} {bottom[0].shape} has no values, so no mean exists"
                )
            self.coeff /= self.dtype.type(count)
        top[0].reshape(bottom[0].shape[:axis])

    def forward(self, bottom: Blobs, top: Blobs) -> None:
        x = bottom[0].data
        terms = {"ASUM": np.abs, "SUMSQ": np.square}.get(self.param.operation, np.asarray)(x)
        top[0].data[...] = self.coeff * terms.sum(axis=self.reduced)

    def backward(self, top: Blobs, propagate_down: list[bool], bottom: Blobs) -> None:
        if not propagate_down[0]:
            return
        x, dx = bottom[0].data, bottom[0].diff
        dx[...] = self.coeff * np.expand_dims(top[0].diff, self.reduced)
        if self.param.operation == "ASUM":
            dx *= np.sign(x)
        elif self.param.operation == "SUMSQ":
            dx *= 2 * x
