"""Eltwise: combine blobs of the same shape elementwise.

bottom[i]  x_i  at least two, of the same shape
top[0]     y    same shape

PROD  y = product of x_i               dx_i = dy times the product of the others
SUM   y = sum of coeff_i x_i           dx_i = coeff_i dy
MAX   y = maximum of x_i               dx_i = dy for the maximum, else 0

Ties in MAX, as in Caffe: x_1 precedes x_0, otherwise the lower index precedes.
``stable_prod_grad: false`` computes the product of the others as y / x_i, which is faster, but NaN
where x_i is 0. Kept for backward: ``winner``, the index of the maximum.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import reduce
from typing import Literal

import numpy as np

from netlib.blob import Blobs
from netlib.layer import Layer, warn_of_ignored
from netlib.proto.schema import numbered


@dataclass(frozen=True)
class EltwiseParameter:
    """The ``eltwise_param { ... }`` block."""

    operation: Literal["PROD", "SUM", "MAX"] = numbered(1, "SUM")
    # SUM: one per bottom, default 1; accepted and ignored in MAX
    coeff: tuple[float, ...] = numbered(2, ())
    stable_prod_grad: bool = numbered(3, True)


class Eltwise(Layer):
    """Product, weighted sum or maximum of blobs."""

    param: EltwiseParameter
    bottoms = (2, None)
    tops = (1, 1)
    in_place = False
    batchwise = True

    def setup(self, bottom: Blobs, top: Blobs) -> None:
        coeff = self.param.coeff
        if coeff and self.param.operation == "PROD":
            raise self.fail("coeff is only valid with operation SUM", "coeff")
        if coeff and len(coeff) != len(bottom):
            raise self.fail(f"has {len(bottom)} bottoms, but {len(coeff)} coeff", "coeff")
        if self.param.operation == "MAX":
            warn_of_ignored(self, "coeff", advice=" with MAX")
        self.coeff = coeff or (1.0,) * len(bottom)
        self.reads_bottom = self.param.operation == "PROD"
        self.reads_top = self.reads_bottom and not self.param.stable_prod_grad

    def reshape(self, bottom: Blobs, top: Blobs) -> None:
        names, first = self.spec.bottom, bottom[0].shape
        for name, x in zip(names, bottom):
            if x.shape != first:
                raise self.fail(
                    f"bottom {name!r} {x.shape} and {names[0]!r} {first} must have the same shape"
                )
        top[0].reshape(first)

    def forward(self, bottom: Blobs, top: Blobs) -> None:
        xs, y = [x.data for x in bottom], top[0].data
        if self.param.operation == "PROD":
            np.multiply(reduce(np.multiply, xs[:-1]), xs[-1], out=y)
        elif self.param.operation == "SUM":
            first, second, *others = (x if c == 1 else c * x for c, x in zip(self.coeff, xs))
            np.add(first, second, out=y)
            for x in others:
                y += x
        else:
            self.winner = np.asarray(~(xs[0] > xs[1])).astype(np.int16)  # as numbers, 0 or 1
            np.maximum(xs[0], xs[1], out=y)
            for i, x in enumerate(xs[2:], 2):
                self.winner[x > y] = i
                np.maximum(y, x, out=y)

    def backward(self, top: Blobs, propagate_down: list[bool], bottom: Blobs) -> None:
        dy = top[0].diff
        for i, (x, down) in enumerate(zip(bottom, propagate_down)):
            if not down:
                continue
            if self.param.operation == "SUM":
                x.diff[...] = dy if self.coeff[i] == 1 else self.coeff[i] * dy
            elif self.param.operation == "MAX":
                x.diff[...] = dy * (self.winner == i)
            elif self.param.stable_prod_grad:
                others = [other.data for k, other in enumerate(bottom) if k != i]
                x.diff[...] = dy * reduce(np.multiply, others)
            else:
                x.diff[...] = dy * (top[0].data / x.data)
