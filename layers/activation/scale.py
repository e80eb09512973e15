"""Scale: multiply by a learned gain (or by a second bottom) that is broadcast over some axes,
and add a bias.

bottom[0]  x     any shape
bottom[1]  gain  optional: used instead of the parameter
params[0]  gain  shape of x's axes ``axis`` to ``axis + num_axes``; default one per
                 channel; initially 1
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

from layers.activation.bias import Broadcast
from netlib.blob import Blobs
from netlib.fillers import Filler
from netlib.proto.schema import numbered


@dataclass(frozen=True)
class ScaleParameter:
    """The ``scale_param { ... }`` block."""

    axis: int = numbered(1, 1)  # first axis of the gain in x
    # number of its axes; -1: all from ``axis`` on; 0: a single number
    num_axes: int = numbered(2, 1)
    filler: Filler = numbered(3, Filler(value=1.0))  # initial gain; default 1
    bias_term: bool = numbered(4, False)
    bias_filler: Filler = numbered(5, Filler())


class Scale(Broadcast):
    """Learned gain and bias."""

    param: ScaleParameter

    def setup(self, bottom: Blobs, top: Blobs) -> None:
        self.learned = len(bottom) == 1
        if self.learned:
            self.gain = self._param_on_axes("gain", bottom[0])
        if self.param.bias_term:
            shape = self.gain.shape if self.learned else bottom[1].shape
            self.bias = self.new_param("bias", shape, self.param.bias_filler)

    def reshape(self, bottom: Blobs, top: Blobs) -> None:
        gain = self.gain.shape if self.learned else bottom[1].shape
        self._broadcast("gain", gain, bottom[0])
        if self.param.bias_term and self.bias.shape != gain:
            raise self.fail(
                f"gain {self.spec.bottom[1]!r} {gain} does not fit the bias {self.bias.shape}"
            )
        top[0].reshape(bottom[0].shape)

    def forward(self, bottom: Blobs, top: Blobs) -> None:
        gain = self.gain.data if self.learned else bottom[1].data
        self.x = bottom[0].data.copy() if bottom[0] is top[0] else None
        np.multiply(bottom[0].data, gain.reshape(self.broadcast_shape), out=top[0].data)
        if self.param.bias_term:
            top[0].data[...] += self.bias.data.reshape(self.broadcast_shape)

    def backward(self, top: Blobs, propagate_down: list[bool], bottom: Blobs) -> None:
        dy = top[0].diff
        x = bottom[0].data if self.x is None else self.x
        gain = self.gain.data if self.learned else bottom[1].data
        if self.param.bias_term:
            self.bias.diff[...] += dy.sum(axis=self.summed_axes)
        if self.learned:
            self.gain.diff[...] += (x * dy).sum(axis=self.summed_axes)
        elif propagate_down[1]:
            bottom[1].diff[...] = (x * dy).sum(axis=self.summed_axes)
        if propagate_down[0]:
            np.multiply(dy, gain.reshape(self.broadcast_shape), out=bottom[0].diff)
