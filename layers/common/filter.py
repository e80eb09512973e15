"""Filter: keep selected items of a batch and drop the others.

bottom[i]   x_i  (N, ...)
bottom[-1]  s    (N,) or (N, 1, ...): the selector; items with a non-zero value are kept
top[i]      y_i  (M, ...), one for each x_i: the M kept items, in order; M may be 0

dx_i = dy_i for kept items, 0 for the others;     s has no gradient

``forward`` determines M and reshapes the tops. Before that they have room for all N items, so that
later layers can be set up. Kept for backward: ``passed``, the indices of the kept items.
"""

from __future__ import annotations

import math

import numpy as np

from netlib.blob import Blobs
from netlib.layer import Layer


class Filter(Layer):
    """Keeps items chosen by a selector."""

    bottoms = (2, None)
    tops = (1, None)
    in_place = False

    def setup(self, bottom: Blobs, top: Blobs) -> None:
        if len(top) != len(bottom) - 1:
            raise self.fail(
                f"has {len(bottom)} bottoms, the last of them the selector, and {len(top)} tops; "
                f"expected {len(bottom) - 1} tops"
            )

    def reshape(self, bottom: Blobs, top: Blobs) -> None:
        selector, name = bottom[-1].shape, self.spec.bottom[-1]
        if not selector or math.prod(selector[1:]) != 1:
            raise self.fail(
                f"the selector {name!r} {selector} must have one value per item, (N,) or (N, 1, ...)"
            )
        for i, (x, y) in enumerate(zip(bottom, top)):
            if x.shape[:1] != selector[:1]:
                raise self.fail(
                    f"bottom {self.spec.bottom[i]!r} {x.shape} and the selector {name!r} {selector} "
                    "must have the same number of items"
                )
            y.reshape(x.shape)

    def allow_force_backward(self, bottom_index: int) -> bool:
        return bottom_index < len(self.spec.bottom) - 1

    def forward(self, bottom: Blobs, top: Blobs) -> None:
        self.passed = np.flatnonzero(bottom[-1].data)
        for x, y in zip(bottom, top):
            y.reshape(len(self.passed), *x.shape[1:])
            y.data[...] = x.data[self.passed]

    def backward(self, top: Blobs, propagate_down: list[bool], bottom: Blobs) -> None:
        if propagate_down[-1]:
            raise self.fail(
                f"the selector {self.spec.bottom[-1]!r} has no gradient; set propagate_down: false"
            )
        for x, y, down in zip(bottom, top, propagate_down):
            if down:
                x.diff[...] = 0
                x.diff[self.passed] = y.diff[: len(self.passed)]
