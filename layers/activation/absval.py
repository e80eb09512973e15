"""AbsVal: absolute value.

bottom[0]  x  any shape
top[0]     y  same shape; not the same blob, as in Caffe

y  = |x|
dx = dy sign(x)        0 at 0
"""

from __future__ import annotations

import numpy as np

from netlib.blob import Blobs
from netlib.layer import Layer


class AbsVal(Layer):
    """Absolute value."""

    bottoms = tops = (1, 1)
    in_place = False

    def reshape(self, bottom: Blobs, top: Blobs) -> None:
        top[0].reshape(bottom[0].shape)

    def forward(self, bottom: Blobs, top: Blobs) -> None:
        np.abs(bottom[0].data, out=top[0].data)

    def backward(self, top: Blobs, propagate_down: list[bool], bottom: Blobs) -> None:
        if propagate_down[0]:
            bottom[0].diff[...] = top[0].diff * np.sign(bottom[0].data)
