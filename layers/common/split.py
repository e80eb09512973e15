"""Split: copy a blob for several readers.

The net inserts this layer automatically (netlib/proto/net_parameter.py).

bottom[0]  x    any shape
top[i]     y_i  same shape

y_i = x             copies; where no layer overwrites one, they share the memory of x, as in Caffe
dx  = sum of dy_i   the gradients of all readers add up
"""

from __future__ import annotations

from netlib.blob import Blobs
from netlib.layer import Layer


class Split(Layer):
    """Copies a blob for several readers."""

    bottoms = (1, 1)
    tops = (1, None)
    in_place = False
    elementwise = batchwise = True
    reads_bottom = reads_top = reads_kept = False

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
