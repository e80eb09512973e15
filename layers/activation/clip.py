"""Clip: limit values to the range from ``min`` to ``max``.

bottom[0]  x  any shape
top[0]     y  same shape, may be the same blob

y  = max(min, min(x, max))
dx = dy where min <= x <= max, 0 elsewhere

Kept for backward: ``inside``, the mask of this condition, because in place y overwrites x.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from netlib.blob import Blobs
from netlib.layer import Layer
from netlib.proto.schema import numbered


@dataclass(frozen=True)
class ClipParameter:
    """The ``clip_param { ... }`` block."""

    min: float = numbered(1)
    max: float = numbered(2)


class Clip(Layer):
    """Limits values to a range."""

    param_type = ClipParameter
    bottoms = tops = (1, 1)

    def reshape(self, bottom: Blobs, top: Blobs) -> None:
        top[0].reshape(bottom[0].shape)

    def forward(self, bottom: Blobs, top: Blobs) -> None:
        x, p = bottom[0].data, self.param
        self.inside = (x >= p.min) & (x <= p.max)
        top[0].data[...] = np.maximum(p.min, np.minimum(x, p.max))

    def backward(self, top: Blobs, propagate_down: list[bool], bottom: Blobs) -> None:
        if propagate_down[0]:
            bottom[0].diff[...] = top[0].diff * self.inside
