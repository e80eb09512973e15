"""FastInnerProduct: each product in nearly equal blocks of features, one per thread: of outputs for y and dw, of inputs
for dx.

Blocks do not depend on the number of threads, so neither does the rounding of a sum; they are large, because every
product packs its factors again. For a few items that takes longer than the product: they are computed one at a time,
since a product with one row reads the weights in place, limited by memory bandwidth. The blocks are then so small that
the second item finds the weights of the first in the cache.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np

from fast import parallel
from fast.fast_layer import FastLayer
from layers.common.inner_product import InnerProduct
from netlib.blob import Blobs
from netlib.system.memory import blocks

MAX_BLOCK = 640  # features; 1,024 are two blocks, one per thread on two cores
FEW_ITEMS = 8  # up to here one by one is faster; benchmarks/parts.py shows both
CACHED_BYTES = 1 << 20  # of the weights of a block, which stay in the cache from item to item
ALIGNED = 64  # outputs; blocks of multiples are rounded as one product of all outputs is


class FastInnerProduct(FastLayer, InnerProduct):
    """Fully connected layer in blocks."""

    def forward(self, bottom: Blobs, top: Blobs) -> None:
        """y = x wᵀ + b by blocks of outputs, or item by item."""
        x, y, w = self.rows(bottom[0].data), self.rows(top[0].data), self.output_first(self.weight.data)

        few = len(x) <= FEW_ITEMS

        def job(o: slice) -> None:
            for rows in blocks(len(x), 1) if few else [slice(None)]:
                np.matmul(x[rows], w[o].T, out=y[rows, o])
            if self.param.bias_term:
                y[:, o] += self.bias.data[o]

        if few:
            cached = max(CACHED_BYTES // max(w[:1].nbytes, 1) // ALIGNED, 1) * ALIGNED
            parallel.run([partial(job, o) for o in blocks(len(w), cached if len(x) > 1 else len(w))])
        else:
            parallel.run(_by_blocks(job, len(w)))

    def backward(self, top: Blobs, propagate_down: list[bool], bottom: Blobs) -> None:
        """dw = dyᵀ x and db by blocks of outputs, dx = dy w by blocks of inputs."""
        x, dy, w = self.rows(bottom[0].data), self.rows(top[0].diff), self.output_first(self.weight.data)
        dw = self.output_first(self.weight.diff)

        def weight_job(o: slice) -> None:
            dw[o] += dy[:, o].T @ x
            if self.param.bias_term:
                self.bias.diff[o] += dy[:, o].sum(axis=0, dtype=np.float64)

        jobs = _by_blocks(weight_job, len(dw))
        if propagate_down[0]:
            dx = self.rows(bottom[0].diff)

            def input_job(i: slice) -> None:
                np.matmul(dy, w[:, i], out=dx[:, i])

            jobs += _by_blocks(input_job, self.inputs)
        parallel.run(jobs)


def _by_blocks(job: Callable[[slice], None], count: int) -> list[Callable[[], None]]:
    """``job`` for each of as few blocks of the features as there can be, nearly equal ones."""
    number = -(-count // MAX_BLOCK)
    return [partial(job, features) for features in blocks(count, -(-count // number))]
