"""InnerProduct: every output is a weighted sum of all inputs of an item ("fully connected").

bottom[0]  x  (..., I)   axes before ``axis`` count items (M of them), the others are flattened to I inputs
params[0]  w  (O, I), or (I, O) with ``transpose``
params[1]  b  (O,)       unless ``bias_term: false``
top[0]     y  (..., O)

y  = x wᵀ + b
dx = dy w
dw = dyᵀ x,   db = sum of dy over the items
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np

from netlib import parallel
from netlib.blob import Array, Blobs
from netlib.fillers import Filler
from netlib.layer import Layer
from netlib.schema import UInt

# A product is computed in nearly equal blocks of features, one a thread: of outputs for y and dw, of inputs for dx.
# Blocks do not depend on the number of threads, so neither does the rounding of a sum; they are large, because every
# product packs its factors anew. For a few items that takes longer than the product: they go one by one, each on one
# thread, since a product with one row reads the weights where they are, as fast as the memory gives them.
LARGEST_BLOCK = 640
FEW_ITEMS = 8


@dataclass(frozen=True)
class InnerProductParameter:
    """The ``inner_product_param { ... }`` block."""

    num_output: UInt
    bias_term: bool = True
    weight_filler: Filler = Filler()
    bias_filler: Filler = Filler()
    axis: int = 1  # first axis of an item
    transpose: bool = False  # store w as (I, O)


class InnerProduct(Layer):
    """Fully connected layer. Not batchwise: one product for the whole batch beats many small ones."""

    param_type = InnerProductParameter
    bottoms = tops = (1, 1)
    in_place = False
    reads_top = False

    def setup(self, bottom: Blobs, top: Blobs) -> None:
        p = self.param
        if p.num_output == 0:
            raise self.fail("num_output must be at least 1", "num_output")
        self.axis = self.canonical_axis(p.axis, bottom[0])
        self.inputs = int(np.prod(bottom[0].shape[self.axis :]))
        shape = (self.inputs, p.num_output) if p.transpose else (p.num_output, self.inputs)
        self.new_param("weight", shape, p.weight_filler).lazily_cleared = True
        if p.bias_term:
            self.new_param("bias", (p.num_output,), p.bias_filler)

    def reshape(self, bottom: Blobs, top: Blobs) -> None:
        items, item = bottom[0].shape[: self.axis], bottom[0].shape[self.axis :]
        if int(np.prod(item)) != self.inputs:
            raise self.fail(
                f"bottom {self.spec.bottom[0]!r} has {int(np.prod(item))} features {item}, "
                f"its weights expect {self.inputs}"
            )
        top[0].reshape(*items, self.param.num_output)

    def weight(self) -> Array:
        """w as (O, I), a view."""
        w = self.blobs[0].data
        return w.T if self.param.transpose else w

    def forward(self, bottom: Blobs, top: Blobs) -> None:
        x, y, w = self._rows(bottom[0].data), self._flat(top[0].data), self.weight()

        def job(rows: slice, o: slice) -> None:
            np.matmul(x[rows], w[o].T, out=y[rows, o])
            if self.param.bias_term:
                y[rows, o] += self.blobs[1].data[o]

        if len(x) <= FEW_ITEMS:
            parallel.run([partial(job, slice(n, n + 1), slice(None)) for n in range(len(x))])
        else:
            _each(partial(job, slice(None)), len(w))

    def backward(self, top: Blobs, propagate_down: list[bool], bottom: Blobs) -> None:
        x, dy, w = self._rows(bottom[0].data), self._flat(top[0].diff), self.weight()
        diff, is_zero = self.blobs[0].diff_to_add_to()
        dw = diff.T if self.param.transpose else diff

        def weight_job(o: slice) -> None:
            if is_zero:  # its memory holds anything: write, do not add
                np.matmul(dy[:, o].T, x, out=dw[o])
            else:
                dw[o] += dy[:, o].T @ x

        _each(weight_job, len(dw))
        if self.param.bias_term:
            self.blobs[1].diff[...] += dy.sum(axis=0)
        if propagate_down[0]:
            dx = self._rows(bottom[0].diff)

            def input_job(i: slice) -> None:
                np.matmul(dy, w[:, i], out=dx[:, i])

            _each(input_job, self.inputs)

    def _rows(self, array: Array) -> Array:
        return array.reshape(-1, self.inputs)

    def _flat(self, array: Array) -> Array:
        return array.reshape(-1, self.param.num_output)


def _each(job: Callable[[slice], None], count: int) -> None:
    """Run ``job`` on as few blocks of the features as there can be, nearly equal ones."""
    number = -(-count // LARGEST_BLOCK)
    parallel.run([partial(job, features) for features in parallel.blocks(count, -(-count // number))])
