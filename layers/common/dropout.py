"""Dropout: set a random part of the values to zero during training, so that units do not co-adapt.

bottom[0]  x  any shape
top[0]     y  same shape, may be the same blob

TRAIN  y = x keep / (1 - p),   dx = dy keep / (1 - p)      keep = 1 with probability 1 - p, else 0
TEST   y = x,                  dx = dy

Kept for backward: ``factor`` = keep / (1 - p). The scale in TRAIN preserves the mean, so TEST needs
none. With ``scale_train: false`` (Fast R-CNN), TEST scales instead: y = x keep in TRAIN, y = x
(1 - p) in TEST. With ``sample_weights_test`` (Bayesian SegNet), TEST computes what TRAIN does.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from netlib.blob import Blobs
from netlib.layer import TRAIN, Layer
from netlib.proto.schema import numbered


@dataclass(frozen=True)
class DropoutParameter:
    """The ``dropout_param { ... }`` block."""

    dropout_ratio: float = numbered(1, 0.5)  # p, the probability that a value is dropped
    scale_train: bool = numbered(2, True)  # from Fast R-CNN's fork of Caffe; false: scale in TEST
    sample_weights_test: bool = numbered(1002, False)  # from SegNet's fork, where its number is 2


class Dropout(Layer):
    """Dropout."""

    param: DropoutParameter
    bottoms = tops = (1, 1)
    reads_bottom = reads_top = False
    keeps_signs = True

    def setup(self, bottom: Blobs, top: Blobs) -> None:
        p = self.param.dropout_ratio
        if not 0 <= p < 1:
            raise self.fail(
                f"dropout_ratio {p:g} must be at least 0 and less than 1", "dropout_ratio"
            )
        drops = self.phase == TRAIN or self.param.sample_weights_test
        self.active = drops and p > 0
        self.batchwise = p == 0 or not drops  # random numbers are drawn for the whole batch
        # what a kept value is multiplied by while some are dropped, and every value otherwise
        self.kept_scale = self.dtype.type(1 / (1 - p) if self.param.scale_train else 1)
        self.all_scale = self.dtype.type(1 if drops or self.param.scale_train else 1 - p)

    def reshape(self, bottom: Blobs, top: Blobs) -> None:
        top[0].reshape(bottom[0].shape)

    def forward(self, bottom: Blobs, top: Blobs) -> None:
        self.factor = self.all_scale
        if self.active:
            # 16 bits: fast, and p to 1/65536
            drawn = self.rng.integers(0, 1 << 16, bottom[0].shape, dtype=np.uint16)
            least = min(round(self.param.dropout_ratio * (1 << 16)), (1 << 16) - 1)
            self.factor = (drawn >= least) * self.kept_scale
        top[0].data[...] = bottom[0].data * self.factor

    def backward(self, top: Blobs, propagate_down: list[bool], bottom: Blobs) -> None:
        if propagate_down[0]:
            bottom[0].diff[...] = top[0].diff * self.factor
