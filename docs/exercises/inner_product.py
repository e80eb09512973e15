# Replace each NotImplementedError, then run: python tools/exercise.py inner_product
"""InnerProduct: every output is a weighted sum of all inputs of an item ("fully connected" layer).

bottom[0]  x  (..., I)   axes before ``axis`` count the M items, the others are flattened to I inputs
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

    param_type = InnerProductParameter
    bottoms = tops = (1, 1)
    in_place = False

    def setup(self, bottom: Blobs, top: Blobs) -> None:
        p = self.param
        if p.num_output == 0:
            raise self.fail("num_output must be at least 1", "num_output")
        self.axis = self.canonical_axis(p.axis, bottom[0])
        self.inputs = math.prod(bottom[0].shape[self.axis :])
        shape = (self.inputs, p.num_output) if p.transpose else (p.num_output, self.inputs)
        self.weight = self.new_param("weight", shape, p.weight_filler)
        if p.bias_term:
            self.bias = self.new_param("bias", (p.num_output,), p.bias_filler)

    def reshape(self, bottom: Blobs, top: Blobs) -> None:
        # Give top[0] the axes before self.axis, followed by one of size self.param.num_output. (The project's layer
        # also raises an error if the number of inputs is no longer self.inputs.)
        raise NotImplementedError

    def forward(self, bottom: Blobs, top: Blobs) -> None:
        # Write top[0].data: y = x wᵀ + b. w is self.weight.data, b is self.bias.data, if self.param.bias_term. rows()
        # and output_first() give the matrices of the formula, as views.
        raise NotImplementedError

    def backward(self, top: Blobs, propagate_down: list[bool], bottom: Blobs) -> None:
        # Add to self.weight.diff and self.bias.diff, with +=: dw = dyᵀ x, db = sum of dy over the items. If
        # propagate_down[0], write bottom[0].diff: dx = dy w.
        raise NotImplementedError

    def rows(self, array: Array) -> Array:
        """View of the items as rows, (M, I) or (M, O)."""
        return array.reshape(-1, math.prod(array.shape[self.axis :]))

    def output_first(self, w: Array) -> Array:
        """View of w or dw as (O, I)."""
        return w.T if self.param.transpose else w
