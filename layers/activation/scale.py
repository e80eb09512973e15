"""Scale: multiply by a learned gain (or by a second bottom) that is broadcast over some axes, and add a bias.

bottom[0]  x     any shape
bottom[1]  gain  optional: used instead of the parameter
params[0]  gain  shape of x's axes ``axis`` to ``axis + num_axes``; default one per channel; initially 1
params[-1] bias  same shape, with ``bias_term: true``
top[0]     y     shape of x, may be the same blob

y     = gain x + bias
dx    = gain dy
dgain = sum of x dy over the other axes,   dbias = sum of dy

Kept for backward: ``x``, because in place y overwrites it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from netlib.blob import Array, Blobs
from netlib.fillers import Filler
from netlib.layer import Layer
from netlib.proto.schema import numbered


@dataclass(frozen=True)
class ScaleParameter:
    """The ``scale_param { ... }`` block."""

    axis: int = numbered(1, 1)  # first axis of the gain in x
    num_axes: int = numbered(2, 1)  # number of its axes; -1: all from ``axis`` on; 0: a single number
    filler: Filler = numbered(3, Filler(value=1.0))  # initial gain; default 1
    bias_term: bool = numbered(4, False)
    bias_filler: Filler = numbered(5, Filler())


class Scale(Layer):
    """Learned gain and bias."""

    param_type = ScaleParameter
    bottoms = (1, 2)
    tops = (1, 1)

    def setup(self, bottom: Blobs, top: Blobs) -> None:
        p = self.param
        self.learned = len(bottom) == 1
        if self.learned:
            axis = self.canonical_axis(p.axis, bottom[0]) if p.num_axes else 0
            end = len(bottom[0].shape) if p.num_axes == -1 else axis + p.num_axes
            if not axis <= end <= len(bottom[0].shape):
                raise self.fail(f"axis {p.axis}, num_axes {p.num_axes} do not fit {bottom[0].shape}", "num_axes")
            self.gain = self.new_param("gain", bottom[0].shape[axis:end], p.filler)
        if p.bias_term:
            shape = self.gain.shape if self.learned else bottom[1].shape
            self.bias = self.new_param("bias", shape, p.bias_filler)

    def reshape(self, bottom: Blobs, top: Blobs) -> None:
        x = bottom[0].shape
        gain = self.gain.shape if self.learned else bottom[1].shape
        self.axis = self.canonical_axis(self.param.axis, bottom[0]) if gain else 0
        end = self.axis + len(gain)
        if x[self.axis : end] != gain:
            raise self.fail(f"gain {gain} does not fit axes {self.axis} to {end} of bottom "
                            f"{self.spec.bottom[0]!r} {x}")
        if self.param.bias_term and self.bias.shape != gain:
            raise self.fail(f"gain {self.spec.bottom[1]!r} {gain} does not fit the bias {self.bias.shape}")
        self.trailing = (1,) * (len(x) - end)
        self.others = tuple(i for i in range(len(x)) if not self.axis <= i < end)
        top[0].reshape(x)

    def _wide(self, array: Array) -> Array:
        """The gain or bias with trailing axes of size 1 for broadcasting."""
        return array.reshape(array.shape + self.trailing)

    def forward(self, bottom: Blobs, top: Blobs) -> None:
        gain = self.gain.data if self.learned else bottom[1].data
        self.x = bottom[0].data.copy() if bottom[0] is top[0] else bottom[0].data
        np.multiply(bottom[0].data, self._wide(gain), out=top[0].data)
        if self.param.bias_term:
            top[0].data[...] += self._wide(self.bias.data)

    def backward(self, top: Blobs, propagate_down: list[bool], bottom: Blobs) -> None:
        dy = top[0].diff
        gain = self.gain.data if self.learned else bottom[1].data
        if self.param.bias_term:
            self.bias.diff[...] += dy.sum(axis=self.others)
        if self.learned:
            self.gain.diff[...] += (self.x * dy).sum(axis=self.others)
        elif propagate_down[1]:
            bottom[1].diff[...] = (self.x * dy).sum(axis=self.others)
        if propagate_down[0]:
            np.multiply(dy, self._wide(gain), out=bottom[0].diff)
