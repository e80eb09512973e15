"""Split: hand one blob to several readers. The net inserts it by itself (netlib/splits.py).

bottom[0]  x    any shape
top[i]     y_i  same shape

y_i = x
dx  = sum of dy_i          what each reader wants of x, taken together
"""

from __future__ import annotations

from netlib.blob import Blobs
from netlib.layer import Layer


class Split(Layer):
    """Copy one blob to several."""

    bottoms = (1, 1)
    tops = (1, None)
    in_place = False

    def reshape(self, bottom: Blobs, top: Blobs) -> None:
        for y in top:
            y.reshape(bottom[0].shape)

    def forward(self, bottom: Blobs, top: Blobs) -> None:
        for y in top:
            y.data[...] = bottom[0].data

    def backward(self, top: Blobs, propagate_down: list[bool], bottom: Blobs) -> None:
        if propagate_down[0]:
            bottom[0].diff[...] = top[0].diff
            for y in top[1:]:
                bottom[0].diff[...] += y.diff
