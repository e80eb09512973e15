"""TanH: hyperbolic tangent, with values in (-1, 1).

bottom[0]  x  any shape
top[0]     y  same shape, may be the same blob

y  = tanh(x)
dx = dy (1 - y²)
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from netlib.blob import Blobs
from netlib.layer import Layer
from netlib.proto.schema import Engine, numbered


@dataclass(frozen=True)
class TanHParameter:
    """The ``tanh_param { ... }`` block."""

    engine: Engine = numbered(1, "DEFAULT")  # accepted, ignored


class TanH(Layer):
    """Hyperbolic tangent."""

    param_type = TanHParameter
    param_name = "tanh_param"
    bottoms = tops = (1, 1)
    reads_top = True

    def reshape(self, bottom: Blobs, top: Blobs) -> None:
        top[0].reshape(bottom[0].shape)

    def forward(self, bottom: Blobs, top: Blobs) -> None:
        np.tanh(bottom[0].data, out=top[0].data)

    def backward(self, top: Blobs, propagate_down: list[bool], bottom: Blobs) -> None:
        if propagate_down[0]:
            y, dy = top[0].data, top[0].diff
            bottom[0].diff[...] = dy * (1 - y * y)
