"""TanH: hyperbolic tangent, with values in (-1, 1).

bottom[0]  x  any shape
top[0]     y  same shape, may be the same blob

y  = tanh(x)
dx = dy (1 - y²)
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from layers.activation.elementwise import Elementwise
from netlib.blob import Array, Blobs
from netlib.proto.schema import Engine, numbered


@dataclass(frozen=True)
class TanHParameter:
    """The ``tanh_param { ... }`` block."""

    engine: Engine = numbered(1, "DEFAULT")  # accepted, ignored


class TanH(Elementwise):
    """Hyperbolic tangent."""

    param: TanHParameter
    param_name = "tanh_param"
    elementwise = True
    reads_bottom, reads_top = False, True

    def forward(self, bottom: Blobs, top: Blobs) -> None:
        np.tanh(bottom[0].data, out=top[0].data)

    def _slope(self, y: Array) -> Array:
        return 1 - y * y
