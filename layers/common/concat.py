"""Concat: join blobs along an axis.

bottom[i]  x_i  equal shapes but for ``axis``
top[0]     y    x_0, x_1, ... one after the other

dx_i = its part of dy
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from netlib.blob import Array, Blobs
from netlib.layer import Layer
from netlib.schema import UInt


@dataclass(frozen=True)
class ConcatParameter:
    """The ``concat_param { ... }`` block."""

    axis: int = 1
    concat_dim: UInt | None = None  # older name of axis


class Concat(Layer):
    """Join blobs."""

    param_type = ConcatParameter
    bottoms = (1, None)
    tops = (1, 1)
    in_place = False

    def reshape(self, bottom: Blobs, top: Blobs) -> None:
        p = self.param
        self.axis = self.canonical_axis(p.axis if p.concat_dim is None else p.concat_dim, bottom[0])
        shape = list(bottom[0].shape)
        for i, x in enumerate(bottom[1:], 1):
            others = [s for k, s in enumerate(x.shape) if k != self.axis]
            if len(x.shape) != len(shape) or others != [s for k, s in enumerate(shape) if k != self.axis]:
                raise self.fail(
                    f"bottom {self.spec.bottom[i]!r} {x.shape} and {self.spec.bottom[0]!r} {bottom[0].shape} "
                    f"may differ in axis {self.axis} only"
                )
            shape[self.axis] += x.shape[self.axis]
        top[0].reshape(shape)
        self.ends = np.cumsum([x.shape[self.axis] for x in bottom])[:-1]

    def forward(self, bottom: Blobs, top: Blobs) -> None:
        for x, part in zip(bottom, self._parts(top[0].data)):
            part[...] = x.data

    def backward(self, top: Blobs, propagate_down: list[bool], bottom: Blobs) -> None:
        for x, part, down in zip(bottom, self._parts(top[0].diff), propagate_down):
            if down:
                x.diff[...] = part

    def _parts(self, array: Array) -> list[Array]:
        return np.split(array, self.ends, axis=self.axis)
