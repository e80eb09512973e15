"""AbsVal: absolute value.

bottom[0]  x  any shape
top[0]     y  same shape; not the same blob, as in Caffe

y  = |x|
dx = dy sign(x)        0 at 0
"""

from __future__ import annotations

import numpy as np

from layers.activation.elementwise import Elementwise
from netlib.blob import Array, Blobs


class AbsVal(Elementwise):
    """Absolute value."""

    in_place = False

    def forward(self, bottom: Blobs, top: Blobs) -> None:
        np.abs(bottom[0].data, out=top[0].data)

    def _slope(self, x: Array) -> Array:
        return np.sign(x)
