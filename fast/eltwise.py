"""FastEltwise: sums of blobs in blocks, without temporary arrays. The plain layer computes products and maxima."""

from __future__ import annotations

from functools import partial

import numpy as np

from fast import parallel
from fast.fast_layer import FastLayer
from fast.fusing import after_of
from fast.parallel import scratch
from fast.per_channel import BLOCK
from layers.common.eltwise import Eltwise
from netlib.blob import Array, Blobs
from netlib.system.memory import blocks


class FastEltwise(FastLayer, Eltwise):
    """Weighted sum of blobs."""

    def fuses_relu(self) -> bool:
        """Whether forward can compute a ReLU behind the layer: for sums."""
        return bool(self.param.operation == "SUM")

    def forward(self, bottom: Blobs, top: Blobs) -> None:
        """Compute y = sum of coeff_i x_i."""
        if self.param.operation != "SUM":
            super().forward(bottom, top)
            return
        after = after_of(None, self.after)
        xs, y = [x.data.reshape(-1) for x in bottom], top[0].data.reshape(-1)

        def job(own: slice) -> None:
            total = _times(xs[0][own], self.coeff[0], "sum")
            for x, c in zip(xs[1:], self.coeff[1:]):
                total = np.add(total, _times(x[own], c, "product"), out=y[own])
            after.activate(total, y[own])

        parallel.run([partial(job, own) for own in blocks(y.size, BLOCK)])

    def backward(self, top: Blobs, propagate_down: list[bool], bottom: Blobs) -> None:
        """Compute dx_i = coeff_i dy."""
        if self.param.operation != "SUM":
            super().backward(top, propagate_down, bottom)
            return
        dy = top[0].diff
        for x, c, down in zip(bottom, self.coeff, propagate_down):
            if down and c == 1:
                x.diff[...] = dy
            elif down:
                np.multiply(dy, c, out=x.diff)


def _times(x: Array, c: float, key: str) -> Array:
    """c x, in working memory unless c is 1."""
    return x if c == 1 else np.multiply(x, x.dtype.type(c), out=scratch(key, x.shape, x.dtype))
