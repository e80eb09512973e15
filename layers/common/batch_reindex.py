"""BatchReindex: select items of a batch, in any order and with repetition.

bottom[0]  x  (N, ...)
bottom[1]  i  (M,)      indices from 0 to N - 1; fractions are truncated
top[0]     y  (M, ...)

y[m]  = x[i[m]]
dx[n] = sum of dy[m] over all m with i[m] = n;     i has no gradient
"""

from __future__ import annotations

import numpy as np

from netlib.blob import Array, Blob, Blobs
from netlib.layer import Layer


class BatchReindex(Layer):
    """Selects items by index."""

    bottoms = (2, 2)
    tops = (1, 1)
    in_place = False

    def reshape(self, bottom: Blobs, top: Blobs) -> None:
        x, index = bottom[0].shape, bottom[1].shape
        if not x or len(index) != 1:
            items, indices = self.spec.bottom
            raise self.fail(
                f"bottoms {items!r} {x} and {indices!r} {index} "
                "must be items (N, ...) and their indices (M,)"
            )
        top[0].reshape(*index, *x[1:])

    def allow_force_backward(self, bottom_index: int) -> bool:
        return bottom_index == 0

    def forward(self, bottom: Blobs, top: Blobs) -> None:
        x, index = bottom[0].data, bottom[1].data
        wrong = index[~((index >= 0) & (index < len(x)))]
        if wrong.size:
            items, indices = self.spec.bottom
            raise self.fail(
                f"bottom {indices!r} has index {wrong[0]:g}, but {items!r} "
                f"{x.shape} has items 0 to {len(x) - 1}"
            )
        top[0].data[...] = x[_indices(bottom[1])]

    def backward(self, top: Blobs, propagate_down: list[bool], bottom: Blobs) -> None:
        if propagate_down[1]:
            raise self.fail(
                f"the indices {self.spec.bottom[1]!r} have no gradient; set propagate_down: false"
            )
        if propagate_down[0]:
            bottom[0].diff[...] = 0
            np.add.at(bottom[0].diff, _indices(bottom[1]), top[0].diff)


def _indices(index: Blob) -> Array:
    return index.data.astype(np.intp)
