"""Elementwise: base class of the layers that compute each value of y from one value of x.

bottom[0]  x  any shape
top[0]     y  same shape, may be the same blob

y  = value(x)
dx = dy slope(x)

A subclass defines these two formulas as ``_write`` and ``_slope``. They are computed in
blocks that stay in the cache with their temporary arrays.

Kept for backward: ``x``, because in place y overwrites it. With ``reads_top``, the slope is
computed from y instead.
"""

from __future__ import annotations

import numpy as np

from netlib.blob import Array, Blobs, blocks
from netlib.layer import Layer

BLOCK = 1 << 15  # values


class Elementwise(Layer):
    """Base class of activations."""

    bottoms = tops = (1, 1)
    batchwise = True
    reads_top = False

    def _write(self, x: Array, y: Array) -> None:
        """Compute y for some values of x. y may be x itself, so x is not read after a part of
        y was written.
        """
        raise NotImplementedError(f"{type(self).__name__} has no _write")

    def _slope(self, x: Array) -> Array:
        """dy/dx for some values of x, or of y with ``reads_top``."""
        raise NotImplementedError(f"{type(self).__name__} has no _slope")

    def reshape(self, bottom: Blobs, top: Blobs) -> None:
        top[0].reshape(bottom[0].shape)

    def forward(self, bottom: Blobs, top: Blobs) -> None:
        if bottom[0] is top[0] and not self.reads_top:
            self.x = bottom[0].data.copy()
        x, y = bottom[0].data.reshape(-1), top[0].data.reshape(-1)
        for part in blocks(x.size, BLOCK):
            self._write(x[part], y[part])

    def backward(self, top: Blobs, propagate_down: list[bool], bottom: Blobs) -> None:
        if propagate_down[0]:
            if self.reads_top:
                read = top[0].data.reshape(-1)
            elif bottom[0] is top[0]:
                read = self.x.reshape(-1)
            else:
                read = bottom[0].data.reshape(-1)
            dy, dx = top[0].diff.reshape(-1), bottom[0].diff.reshape(-1)
            for part in blocks(read.size, BLOCK):
                np.multiply(dy[part], self._slope(read[part]), out=dx[part])


# NumPy's maximum with a number takes three times as long as its clip.


def positive(x: Array) -> Array:
    """max(x, 0)."""
    return x.clip(0, np.inf)


def negative(x: Array) -> Array:
    """min(x, 0)."""
    return x.clip(-np.inf, 0)


def sigmoid(x: Array, beta: float = 1.0, out: Array | None = None) -> Array:
    """1 / (1 + exp(-beta x)), by tanh, which NumPy computes faster and cannot overflow; ``out``
    may be x itself.
    """
    y = np.multiply(x, beta / 2, out=np.empty_like(x) if out is None else out)
    np.tanh(y, out=y)
    y *= 0.5
    y += 0.5
    return y
