"""PReLU: a ReLU with a learned slope for negative values, one per channel.

bottom[0]  x      (N, C, ...)
params[0]  slope  (C,), or () with ``channel_shared``; initially 0.25
top[0]     y      shape of x, may be the same blob

y      = max(x, 0) + slope min(x, 0)
dx     = dy where x > 0, slope dy elsewhere
dslope = sum of dy min(x, 0) over the other axes

Kept for backward: ``x``, because in place y overwrites it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from layers.activation.elementwise import BLOCK, negative, positive
from netlib.blob import Blobs, blocks
from netlib.fillers import Filler
from netlib.layer import Layer
from netlib.proto.schema import numbered


@dataclass(frozen=True)
class PReLUParameter:
    """The ``prelu_param { ... }`` block."""

    filler: Filler = numbered(1, Filler(value=0.25))  # initial slopes
    channel_shared: bool = numbered(2, False)  # one slope for all channels


class PReLU(Layer):
    """Rectified linear unit with learned slopes."""

    param: PReLUParameter
    param_name = "prelu_param"
    bottoms = tops = (1, 1)
    batchwise = True
    reads_top = False

    def setup(self, bottom: Blobs, top: Blobs) -> None:
        shape = () if self.param.channel_shared else bottom[0].shape[1:2]
        self.slope = self.new_param("slope", shape, self.param.filler)

    def reshape(self, bottom: Blobs, top: Blobs) -> None:
        x, slope = bottom[0].shape, self.slope.shape
        if len(x) < 2:
            raise self.fail(f"bottom {self.spec.bottom[0]!r} has shape {x}, expected (N, C, ...)")
        if slope not in ((), x[1:2]):
            raise self.fail(
                f"bottom {self.spec.bottom[0]!r} has {x[1]} channels {x}, its slopes expect {slope[0]}"
            )
        self.broadcast_shape = slope + (1,) * (len(x) - 2)  # (C, 1, ...)
        self.summed_axes = tuple(i for i in range(len(x)) if i != 1 or not slope)
        top[0].reshape(x)

    def forward(self, bottom: Blobs, top: Blobs) -> None:
        self.x = bottom[0].data.copy() if bottom[0] is top[0] else None
        x = bottom[0].data if self.x is None else self.x
        y = top[0].data
        slope = self.slope.data.reshape(self.broadcast_shape)
        is_maximum = ((slope <= 1) & (slope != 0)).all()  # then y = max(x, slope x)
        items_per_block = max(BLOCK * len(y) // max(y.size, 1), 1)
        for items in blocks(len(y), items_per_block):
            x_block, y_block = x[items], y[items]
            if is_maximum:
                np.maximum(x_block, np.multiply(slope, x_block, out=y_block), out=y_block)
            else:
                np.add(positive(x_block), slope * negative(x_block), out=y_block)

    def backward(self, top: Blobs, propagate_down: list[bool], bottom: Blobs) -> None:
        dy, slope = top[0].diff, self.slope.data.reshape(self.broadcast_shape)
        x = bottom[0].data if self.x is None else self.x
        self.slope.diff[...] += (dy * negative(x)).sum(axis=self.summed_axes)
        if propagate_down[0]:
            np.multiply(dy, (x > 0) + slope * (x <= 0), out=bottom[0].diff)
