"""Threshold: 1 above a threshold, else 0. It has no gradient.

bottom[0]  x  any shape
top[0]     y  same shape, may be the same blob

y = 1 where x > threshold, 0 elsewhere
"""

from __future__ import annotations

from dataclasses import dataclass

from netlib.blob import Blobs
from netlib.layer import Layer
from netlib.proto.schema import numbered


@dataclass(frozen=True)
class ThresholdParameter:
    """The ``threshold_param { ... }`` block."""

    threshold: float = numbered(1, 0.0)


class Threshold(Layer):
    """Binary threshold."""

    param: ThresholdParameter
    bottoms = tops = (1, 1)
    has_gradient = False

    def reshape(self, bottom: Blobs, top: Blobs) -> None:
        top[0].reshape(bottom[0].shape)

    def forward(self, bottom: Blobs, top: Blobs) -> None:
        top[0].data[...] = bottom[0].data > self.param.threshold
