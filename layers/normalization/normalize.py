"""Normalize: scale the channels at each position, or each item, to unit length, then by a learned
gain (ParseNet, SSD).

bottom[0]  x      (N, C, ...)
params[0]  scale  (C,), or () with ``channel_shared``; initially 1
top[0]     y      same shape, may be the same blob

u  = x / s        s = sqrt(sum of x² + eps), over the channels at each position;
                  with ``across_spatial`` over the item
y  = scale u
dx = (g - u * sum of (u g)) / s        with g = scale dy and the sum as in s
dscale = sum of u dy over the other axes

With a scale per channel Caffe computes the sum in dx from dy instead of g, which is not the
gradient of y.

Kept for backward: ``u`` and ``s``.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from netlib.blob import Blobs
from netlib.fillers import Filler
from netlib.layer import Layer
from netlib.proto.schema import numbered


@dataclass(frozen=True)
class NormalizeParameter:
    """The ``norm_param { ... }`` block."""

    across_spatial: bool = numbered(1, True)  # one length per item instead of one per position
    scale_filler: Filler = numbered(2, Filler(value=1.0))  # initial scale; default 1
    channel_shared: bool = numbered(3, True)  # one scale for all channels
    eps: float = numbered(4, 1e-10)


class Normalize(Layer):
    """Division by the L2 norm, and a learned gain."""

    param: NormalizeParameter
    param_name = "norm_param"
    bottoms = tops = (1, 1)

    def setup(self, bottom: Blobs, top: Blobs) -> None:
        x = bottom[0].shape
        if len(x) < 2:
            raise self.fail(f"bottom {self.spec.bottom[0]!r} has shape {x}, expected (N, C, ...)")
        self.scale = self.new_param(
            "scale", () if self.param.channel_shared else x[1:2], self.param.scale_filler
        )

    def reshape(self, bottom: Blobs, top: Blobs) -> None:
        x, scale = bottom[0].shape, self.scale.shape
        if len(x) < 2 or scale not in ((), x[1:2]):
            name, channels = self.spec.bottom[0], scale[0] if scale else "C"
            raise self.fail(
                f"bottom {name!r} has shape {x}, its scale expects (N, {channels}, ...)"
            )
        self.axes = tuple(range(1, len(x))) if self.param.across_spatial else (1,)
        # shape of the scale for broadcasting
        self.wide = scale + (1,) * (len(x) - 2) if scale else ()
        self.others = tuple(axis for axis in range(len(x)) if axis != 1 or not scale)
        top[0].reshape(x)

    def forward(self, bottom: Blobs, top: Blobs) -> None:
        x = bottom[0].data
        total = np.square(x).sum(axis=self.axes, keepdims=True)
        self.s = np.sqrt(total + self.dtype.type(self.param.eps))
        self.u = x / self.s
        np.multiply(self.u, self.scale.data.reshape(self.wide), out=top[0].data)

    def backward(self, top: Blobs, propagate_down: list[bool], bottom: Blobs) -> None:
        dy = top[0].diff
        self.scale.diff[...] += (self.u * dy).sum(axis=self.others)
        if propagate_down[0]:
            g = dy * self.scale.data.reshape(self.wide)
            along = (self.u * g).sum(axis=self.axes, keepdims=True)
            np.divide(g - self.u * along, self.s, out=bottom[0].diff)
