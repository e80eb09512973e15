"""Bias: add a learned blob (or a second bottom) that is broadcast over some axes.

bottom[0]  x     any shape
bottom[1]  b     optional: used instead of the parameter
params[0]  bias  shape of x's axes ``axis`` to ``axis + num_axes``; default one per channel; initially 0
top[0]     y     shape of x, may be the same blob

y  = x + b
dx = dy
db = sum of dy over the other axes
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from netlib.blob import Blobs
from netlib.fillers import Filler
from netlib.layer import Layer
from netlib.proto.schema import numbered


@dataclass(frozen=True)
class BiasParameter:
    """The ``bias_param { ... }`` block."""

    axis: int = numbered(1, 1)  # first axis of the bias in x
    num_axes: int = numbered(2, 1)  # number of its axes; -1: all from ``axis`` on; 0: a single number
    filler: Filler = numbered(3, Filler())  # initial bias; default 0


class Bias(Layer):
    """Learned bias."""

    param_type = BiasParameter
    bottoms = (1, 2)
    tops = (1, 1)

    def setup(self, bottom: Blobs, top: Blobs) -> None:
        p, x = self.param, bottom[0].shape
        self.learned = len(bottom) == 1
        if self.learned:
            axis = self.canonical_axis(p.axis, bottom[0]) if p.num_axes else 0
            end = len(x) if p.num_axes == -1 else axis + p.num_axes
            if not axis <= end <= len(x):
                raise self.fail(f"axis {p.axis}, num_axes {p.num_axes} do not fit {x}", "num_axes")
            self.bias = self.new_param("bias", x[axis:end], p.filler)

    def reshape(self, bottom: Blobs, top: Blobs) -> None:
        x = bottom[0].shape
        bias = self.bias.shape if self.learned else bottom[1].shape
        axis = self.canonical_axis(self.param.axis, bottom[0]) if bias else 0
        end = axis + len(bias)
        if x[axis:end] != bias:
            raise self.fail(f"bias {bias} does not fit axes {axis} to {end} of bottom {self.spec.bottom[0]!r} {x}")
        self.wide = bias + (1,) * (len(x) - end)  # shape for broadcasting
        self.others = tuple(i for i in range(len(x)) if not axis <= i < end)
        top[0].reshape(x)

    def forward(self, bottom: Blobs, top: Blobs) -> None:
        b = self.bias.data if self.learned else bottom[1].data
        np.add(bottom[0].data, b.reshape(self.wide), out=top[0].data)

    def backward(self, top: Blobs, propagate_down: list[bool], bottom: Blobs) -> None:
        dy = top[0].diff
        if self.learned:
            self.bias.diff[...] += dy.sum(axis=self.others)
        elif propagate_down[1]:
            bottom[1].diff[...] = dy.sum(axis=self.others)
        if propagate_down[0]:
            bottom[0].diff[...] = dy
