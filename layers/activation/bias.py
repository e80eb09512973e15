"""Bias: add a learned blob (or a second bottom) that is broadcast over some axes.

bottom[0]  x     any shape
bottom[1]  b     optional: used instead of the parameter
params[0]  bias  shape of x's axes ``axis`` to ``axis + num_axes``; default one per
                 channel; initially 0
top[0]     y     shape of x, may be the same blob

y  = x + b
dx = dy
db = sum of dy over the other axes
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from netlib.blob import Blob, Blobs
from netlib.fillers import Filler
from netlib.layer import Layer
from netlib.proto.schema import numbered


@dataclass(frozen=True)
class BiasParameter:
    """The ``bias_param { ... }`` block."""

    axis: int = numbered(1, 1)  # first axis of the bias in x
    # number of its axes; -1: all from ``axis`` on; 0: a single number
    num_axes: int = numbered(2, 1)
    filler: Filler = numbered(3, Filler())  # initial bias; default 0


class Broadcast(Layer):
    """Base class of Bias and Scale: a parameter, or a second bottom, is broadcast over
    some axes of x.

    learned  whether it is the parameter
    axis     its first axis in x
    wide     its shape for broadcasting
    others   the other axes of x
    """

    learned: bool
    bottoms = (1, 2)
    tops = (1, 1)
    reads_top = False

    def _param_on_axes(self, name: str, x: Blob) -> Blob:
        """Create the parameter on the axes of x that the options select. Raises LayerError."""
        p = self.param
        axis = self.canonical_axis(p.axis, x) if p.num_axes else 0
        end = len(x.shape) if p.num_axes == -1 else axis + p.num_axes
        if not axis <= end <= len(x.shape):
            raise self.fail(
                f"axis {p.axis}, num_axes {p.num_axes} do not fit {x.shape}", "num_axes"
            )
        return self.new_param(name, x.shape[axis:end], p.filler)

    def _broadcast(self, name: str, shape: tuple[int, ...], x: Blob) -> None:
        """Find the axes of x for an array of this shape. Raises LayerError."""
        self.axis = self.canonical_axis(self.param.axis, x) if shape else 0
        end = self.axis + len(shape)
        if x.shape[self.axis : end] != shape:
            bottom = self.spec.bottom[0]
            raise self.fail(
                f"{name} {shape} does not fit axes {self.axis} to {end} of bottom "
                f"{bottom!r} {x.shape}"
            )
        self.broadcast_shape = shape + (1,) * (len(x.shape) - end)
        self.summed_axes = tuple(i for i in range(len(x.shape)) if not self.axis <= i < end)
        # a second bottom may have another number of items
        self.batchwise = self.learned and 0 in self.summed_axes


class Bias(Broadcast):
    """Learned bias."""

    param: BiasParameter
    reads_bottom = False

    def setup(self, bottom: Blobs, top: Blobs) -> None:
        self.learned = len(bottom) == 1
        if self.learned:
            self.bias = self._param_on_axes("bias", bottom[0])

    def reshape(self, bottom: Blobs, top: Blobs) -> None:
        self._broadcast("bias", self.bias.shape if self.learned else bottom[1].shape, bottom[0])
        top[0].reshape(bottom[0].shape)

    def forward(self, bottom: Blobs, top: Blobs) -> None:
        b = self.bias.data if self.learned else bottom[1].data
        np.add(bottom[0].data, b.reshape(self.broadcast_shape), out=top[0].data)

    def backward(self, top: Blobs, propagate_down: list[bool], bottom: Blobs) -> None:
        dy = top[0].diff
        if self.learned:
            self.bias.diff[...] += dy.sum(axis=self.summed_axes)
        elif propagate_down[1]:
            bottom[1].diff[...] = dy.sum(axis=self.summed_axes)
        if propagate_down[0]:
            bottom[0].diff[...] = dy
