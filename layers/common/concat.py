"""Concat: concatenate blobs along an axis.

bottom[i]  x_i  equal shapes except along ``axis``
top[0]     y    x_0, x_1, ... in sequence

dx_i = the corresponding part of dy
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from netlib.blob import Array, Blobs
from netlib.layer import Layer
from netlib.proto import schema
from netlib.proto.schema import UInt, numbered


@dataclass(frozen=True)
class ConcatParameter:
    """The ``concat_param { ... }`` block."""

    axis: int = numbered(2, 1)
    concat_dim: UInt | None = numbered(1, None)  # older name of axis


class Concat(Layer):
    """Concatenates blobs."""

    param: ConcatParameter
    bottoms = (1, None)
    tops = (1, 1)
    in_place = False
    reads_bottom = reads_top = False

    def setup(self, bottom: Blobs, top: Blobs) -> None:
        if self.param.concat_dim is not None and schema.is_given(self.param, "axis"):
            raise self.fail(
                "axis and concat_dim are the same option; expected only one of them", "concat_dim"
            )

    def reshape(self, bottom: Blobs, top: Blobs) -> None:
        p, first = self.param, bottom[0].shape
        given = p.axis if p.concat_dim is None else p.concat_dim
        self.axis = axis = self.canonical_axis(given, bottom[0])

        def others(shape: tuple[int, ...]) -> tuple[int, ...]:
            return shape[:axis] + shape[axis + 1 :]

        for name, x in zip(self.spec.bottom, bottom):
            if len(x.shape) != len(first) or others(x.shape) != others(first):
                raise self.fail(
                    f"bottom {name!r} {x.shape} and {self.spec.bottom[0]!r} {first} may differ only along axis {axis}"
                )
        self.batchwise = axis > 0
        sizes = [x.shape[axis] for x in bottom]
        self.ends = np.cumsum(sizes)[:-1]
        top[0].reshape(*first[:axis], sum(sizes), *first[axis + 1 :])

    def forward(self, bottom: Blobs, top: Blobs) -> None:
        for x, part in zip(bottom, self._parts(top[0].data)):
            part[...] = x.data

    def backward(self, top: Blobs, propagate_down: list[bool], bottom: Blobs) -> None:
        for x, part, down in zip(bottom, self._parts(top[0].diff), propagate_down):
            if down:
                x.diff[...] = part

    def _parts(self, array: Array) -> list[Array]:
        return np.split(array, self.ends, axis=self.axis)
