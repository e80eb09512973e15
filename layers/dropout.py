"""Dropout: while training, set a random part of the values to zero, so that no unit relies on another.

bottom[0]  x  any shape
top[0]     y  same shape, may be the same blob

TRAIN  y = x keep / (1 - p),   dx = dy keep / (1 - p)      keep = 1 with probability 1 - p, else 0
TEST   y = x,                  dx = dy

Kept for backward: ``keep``. Scaling in TRAIN keeps the mean, so TEST needs no scale.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from netlib import TRAIN
from netlib.blob import Array, Blobs
from netlib.layer import Layer


@dataclass(frozen=True)
class DropoutParameter:
    """The ``dropout_param { ... }`` block."""

    dropout_ratio: float = 0.5  # p, the part that is dropped


class Dropout(Layer):
    """Dropout. Not batchwise: a mask for the whole batch comes from one stream of random numbers."""

    param_type = DropoutParameter
    bottoms = tops = (1, 1)
    reads_bottom = reads_top = False

    def setup(self, bottom: Blobs, top: Blobs) -> None:
        p = self.param.dropout_ratio
        if not 0 <= p < 1:
            raise self.fail(f"dropout_ratio {p:g} must be at least 0 and less than 1", "dropout_ratio")
        self.active = self.phase == TRAIN and p > 0
        self.threshold = np.uint16(min(round(p * 65536), 65535))
        self.scale = self.dtype.type(1 / (1 - p))

    def reshape(self, bottom: Blobs, top: Blobs) -> None:
        top[0].reshape(bottom[0].shape)
        if self.active:
            self.keep = np.empty(bottom[0].shape, bool)

    def forward(self, bottom: Blobs, top: Blobs) -> None:
        if self.active:
            # 16 random bits a value are enough, and four times as fast as a random float
            words = self.rng.integers(0, 2**64, size=-(-self.keep.size // 4), dtype=np.uint64)
            bits = words.view(np.uint16)[: self.keep.size].reshape(self.keep.shape)
            np.greater_equal(bits, self.threshold, out=self.keep)
        self._mask(bottom[0].data, top[0].data)

    def backward(self, top: Blobs, propagate_down: list[bool], bottom: Blobs) -> None:
        if propagate_down[0]:
            self._mask(top[0].diff, bottom[0].diff)

    def _mask(self, source: Array, target: Array) -> None:
        if self.active:
            np.multiply(source, self.keep, out=target)
            target *= self.scale
        elif target is not source:
            target[...] = source
