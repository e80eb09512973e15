"""InnerProduct: every output is a weighted sum of all inputs of an item ("fully connected" layer).

bottom[0]  x  (..., I)   axes before ``axis`` count the M items, the others are
                         flattened to I inputs
params[0]  w  (O, I), or (I, O) with ``transpose``
params[1]  b  (O,)       unless ``bias_term: false``
top[0]     y  (..., O)

y  = x wᵀ + b
dx = dy w
dw = dyᵀ x,   db = sum of dy over the items
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from netlib.blob import Array, Blobs
from netlib.fillers import Filler
from netlib.layer import Layer
from netlib.proto.schema import UInt, numbered


@dataclass(frozen=True)
class InnerProductParameter:
    """The ``inner_product_param { ... }`` block."""

    num_output: UInt = numbered(1)
    bias_term: bool = numbered(2, True)
    weight_filler: Filler = numbered(3, Filler())
    bias_filler: Filler = numbered(4, Filler())
    axis: int = numbered(5, 1)  # first axis of an item
    transpose: bool = numbered(6, False)  # store w as (I, O)


class InnerProduct(Layer):
    """Fully connected layer."""

    param: InnerProductParameter
    bottoms = tops = (1, 1)
    in_place = False
    reads_top = reads_kept = False

    def setup(self, bottom: Blobs, top: Blobs) -> None:
        p = self.param
        if p.num_output == 0:
            raise self.fail("num_output must be at least 1", "num_output")
        self.axis = self.canonical_axis(p.axis, bottom[0])
        self.batchwise = self.axis > 0
        self.inputs = math.prod(bottom[0].shape[self.axis :])
        shape = (self.inputs, p.num_output) if p.transpose else (p.num_output, self.inputs)
        self.weight = self.new_param("weight", shape, p.weight_filler)
        if p.bias_term:
            self.bias = self.new_param("bias", (p.num_output,), p.bias_filler)

    def reshape(self, bottom: Blobs, top: Blobs) -> None:
        items, item = bottom[0].shape[: self.axis], bottom[0].shape[self.axis :]
        if math.prod(item) != self.inputs:
            raise self.fail(
                f"bottom {self.spec.bottom[0]!r} has {math.prod(item)} features {item}, "
                f"its weights expect {self.inputs}"
            )
        top[0].reshape(*items, self.param.num_output)

    def forward(self, bottom: Blobs, top: Blobs) -> None:
        x, y = self.rows(bottom[0].data), self.rows(top[0].data)
        w = self.output_first(self.weight.data)
        y[...] = x @ w.T
        if self.param.bias_term:
            y += self.bias.data

    def backward(self, top: Blobs, propagate_down: list[bool], bottom: Blobs) -> None:
        x, dy = self.rows(bottom[0].data), self.rows(top[0].diff)
        w = self.output_first(self.weight.data)
        self.output_first(self.weight.diff)[...] += dy.T @ x
        if self.param.bias_term:
            # float32 loses 3 digits over 200,000 items
            self.bias.diff[...] += dy.sum(axis=0, dtype=np.float64)
        if propagate_down[0]:
            self.rows(bottom[0].diff)[...] = dy @ w

    def rows(self, array: Array) -> Array:
        """View of the items as rows, (M, I) or (M, O)."""
        return array.reshape(-1, math.prod(array.shape[self.axis :]))

    def output_first(self, w: Array) -> Array:
        """View of w or dw as (O, I)."""
        return w.T if self.param.transpose else w
