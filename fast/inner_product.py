"""FastInnerProduct: computes each matrix product in nearly equal blocks of features on
several threads.

The blocks are blocks of outputs for y and dw, and of inputs for dx. They do not depend on the
number of threads, so rounding does not depend on it either. They are large, because BLAS packs both
factors of every product. For a few items packing takes longer than the product, so items are
computed one at a time: a product with one row reads the weights in place, limited by memory
bandwidth. These blocks are so small that their weights stay in the cache between items.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np

from fast import parallel
from fast.fast_layer import FastLayer
from fast.parallel import equal_blocks, scratch
from layers.common.inner_product import InnerProduct
from netlib.blob import Array, Blobs, blocks, divide_up

MAX_BLOCK = 640  # features; 1,024 features are two blocks, one per thread on two cores
# up to this number, items are faster one at a time (measured by experiments/parts.py)
FEW_ITEMS = 8
CACHED_BYTES = 1 << 20  # size of a block's weights, so that they stay in the cache between items
# size of weights that are read from main memory, which takes longer than starting threads
LARGE_BYTES = 32 << 20
SUM_VALUES = 1 << 21  # of dw computed before they are added, in memory that is used again
MIN_COST = 4_000_000  # multiplications for dw, from which starting threads takes less time
ALIGNED = 64  # outputs; blocks of multiples of this size round like one product of all outputs


class FastInnerProduct(FastLayer, InnerProduct):
    """Fully connected layer computed in blocks."""

    def forward(self, bottom: Blobs, top: Blobs) -> None:
        """Compute y = x wᵀ + b in blocks of outputs, for a few items one at a time."""
        x, y = self.rows(bottom[0].data), self.rows(top[0].data)
        w = self.output_first(self.weight.data)
        few = len(x) <= FEW_ITEMS

        def job(o: slice) -> None:
            for rows in blocks(len(x), 1) if few else [slice(None)]:
                np.matmul(x[rows], w[o].T, out=y[rows, o])
            if self.param.bias_term:
                y[:, o] += self.bias.data[o]

        if few:
            parts = blocks(len(w), _few_outputs(len(x), w))
            parallel.run([partial(job, o) for o in parts])
        else:
            parallel.run(_by_blocks(job, len(w)))

    def backward(self, top: Blobs, propagate_down: list[bool], bottom: Blobs) -> None:
        """Compute dw = dyᵀ x and db in blocks of outputs, and dx = dy w in blocks of inputs."""
        x, dy = self.rows(bottom[0].data), self.rows(top[0].diff)
        w, dw = self.output_first(self.weight.data), self.output_first(self.weight.diff)
        # matmul computes the product of two vectors without BLAS
        multiply = np.dot if len(x) == 1 else np.matmul

        def weight_job(o: slice) -> None:
            for i in blocks(self.inputs, max(SUM_VALUES // max(o.stop - o.start, 1), 1)):
                out = scratch("result", (o.stop - o.start, i.stop - i.start), dw.dtype)
                dw[o, i] += multiply(dy[:, o].T, x[:, i], out=out)
            if self.param.bias_term:
                self.bias.diff[o] += dy[:, o].sum(axis=0, dtype=np.float64)

        jobs = _by_blocks(weight_job, len(dw))
        if propagate_down[0]:
            dx = self.rows(bottom[0].diff)

            def input_job(i: slice) -> None:
                np.matmul(dy, w[:, i], out=dx[:, i])

            jobs += _by_blocks(input_job, self.inputs)
        parallel.run(jobs, here=w.size * max(len(x), FEW_ITEMS) < MIN_COST)


def _few_outputs(items: int, w: Array) -> int:
    """Number of outputs in a block of the weights w (O, inputs) for a few items; one item reads
    all weights once.
    """
    if items > 1:
        return max(CACHED_BYTES // max(w[:1].nbytes, 1) // ALIGNED, 1) * ALIGNED
    if w.nbytes < LARGE_BYTES:
        return len(w)
    return divide_up(len(w), parallel.threads() * ALIGNED) * ALIGNED


def _by_blocks(job: Callable[[slice], None], count: int) -> list[Callable[[], None]]:
    """Return one call of ``job`` per block, for the smallest possible number of nearly equal
    blocks of features.
    """
    features = equal_blocks(count, divide_up(count, MAX_BLOCK))
    return [partial(job, part) for part in features]
