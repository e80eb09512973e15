"""FastInnerProduct: each product in nearly equal blocks of features, one per thread: of outputs for y and dw, of inputs
for dx.

Blocks do not depend on the number of threads, so neither does the rounding of a sum; they are large, because every
product packs its factors anew. For a few items that takes longer than the product: they go one by one, each on one
thread, since a product with one row reads the weights where they are, as fast as the memory gives them.

The gradient of the weights, large, is written instead of cleared and added to (tiles.LazilyCleared).
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np

from fast import parallel
from fast.tiles import LazilyCleared
from fast.twin import Twin
from layers.common.inner_product import InnerProduct
from netlib.blob import Blob, Blobs
from netlib.system.memory import blocks

LARGEST_BLOCK = 640  # features; 1,024 are two blocks, one per thread on two cores
FEW_ITEMS = 8  # up to here one by one is faster; benchmarks/parts.py shows both


class FastInnerProduct(Twin, InnerProduct):
    """Fully connected layer in blocks."""

    def setup(self, bottom: Blobs, top: Blobs) -> None:
        """Make the gradient of the weights one that may be written."""
        super().setup(bottom, top)
        w = self.weight
        if not (self.spec.param and self.spec.param[0].name):  # another layer that shares it may keep the array
            self.weight = self.blobs[0] = LazilyCleared(w.shape, w.dtype, w.data)

    def forward(self, bottom: Blobs, top: Blobs) -> None:
        """y = x wᵀ + b by blocks of outputs, or item by item."""
        x, y, w = self.rows(bottom[0].data), self.rows(top[0].data), self.output_first(self.weight.data)

        def job(rows: slice, o: slice) -> None:
            np.matmul(x[rows], w[o].T, out=y[rows, o])
            if self.param.bias_term:
                y[rows, o] += self.bias.data[o]

        if len(x) <= FEW_ITEMS:
            parallel.run([partial(job, slice(n, n + 1), slice(None)) for n in range(len(x))])
        else:
            _each(partial(job, slice(None)), len(w))

    def backward(self, top: Blobs, propagate_down: list[bool], bottom: Blobs) -> None:
        """dw = dyᵀ x and db by blocks of outputs, dx = dy w by blocks of inputs."""
        x, dy, w = self.rows(bottom[0].data), self.rows(top[0].diff), self.output_first(self.weight.data)
        diff, is_zero = _to_add_to(self.weight)
        dw = self.output_first(diff)

        def weight_job(o: slice) -> None:
            if is_zero:
                np.matmul(dy[:, o].T, x, out=dw[o])
            else:
                dw[o] += dy[:, o].T @ x
            if self.param.bias_term:
                self.bias.diff[o] += dy[:, o].sum(axis=0, dtype=np.float64)

        _each(weight_job, len(dw))
        if propagate_down[0]:
            dx = self.rows(bottom[0].diff)

            def input_job(i: slice) -> None:
                np.matmul(dy, w[:, i], out=dx[:, i])

            _each(input_job, self.inputs)


def _to_add_to(w: Blob) -> tuple[np.ndarray, bool]:
    return w.to_add_to() if isinstance(w, LazilyCleared) else (w.diff, False)


def _each(job: Callable[[slice], None], count: int) -> None:
    """Run ``job`` on as few blocks of the features as there can be, nearly equal ones."""
    number = -(-count // LARGEST_BLOCK)
    parallel.run([partial(job, features) for features in blocks(count, -(-count // number))])
