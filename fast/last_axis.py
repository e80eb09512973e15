"""Maps with the number of the map as last axis, so that the values under an element of a window are long vectors.

    values (sw, H, W, M)    column v of a padded map is at [v % sw, ..., v // sw, :], for a horizontal stride sw

For a row of outputs, the values under an element of all windows of all maps are one vector of Wo M adjacent values, for
any stride.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from fast.geometry import Geometry
from fast.parallel import scratch
from netlib.blob import Array

Pair = tuple[int, ...]


class Maps:
    """M padded maps in working memory of the thread, filled with one value.

    values   (sw, H, W, M)
    outputs  (Ho, Wo)
    """

    def __init__(self, g: Geometry, sizes: Pair, outputs: Pair, like: Array, fill: float) -> None:
        self.g, self.outputs = g, outputs
        self.values = scratch("maps", (*shape_of(g, sizes, outputs), len(like)), like.dtype)
        self.values.fill(fill)

    def _phases(self, by_place: Array) -> Iterator[tuple[Array, Array]]:
        """For each remainder of the columns, the values of (H, W, M), and their place."""
        step, (top, left) = self.g.stride[1], self.g.pad
        for v in range(step):
            inside = by_place[:, (v - left) % step :: step]
            first = -(-(left - v) // step)
            yield inside, self.values[v, top : top + len(by_place), first : first + inside.shape[1]]

    def read(self, x: Array) -> None:
        """Copy x (M, H, W) to the maps."""
        for inside, places in self._phases(x.transpose(1, 2, 0)):
            places[...] = inside

    def write(self, x: Array) -> None:
        """Copy the maps to x (M, H, W)."""
        for inside, places in self._phases(x.transpose(1, 2, 0)):
            inside[...] = places

    def vectors(self, rows: slice | None = None) -> Iterator[tuple[tuple[int, ...], Array]]:
        """For each element of a window, the values under it for these rows of outputs, (rows, Wo M)."""
        rows = rows or slice(0, self.outputs[0])
        (step, H, _, M), R = self.values.shape, rows.stop - rows.start
        by_row = self.values.reshape(step, H, -1)
        for i, j in np.ndindex(*self.g.kernel):
            first = rows.start * self.g.stride[0] + i * self.g.dilation[0]
            under = slice(first, first + (R - 1) * self.g.stride[0] + 1, self.g.stride[0])
            column, phase = divmod(j * self.g.dilation[1], step)
            yield (i, j), by_row[phase, under, column * M : (column + self.outputs[1]) * M]

    def reduce(self, op: np.ufunc, out: Array) -> Array:
        """Write ``op`` over all elements of each window to out (Ho, Wo M): first over rows, then over columns."""
        (step, _, W, M), (Ho, Wo) = self.values.shape, self.outputs
        over = scratch("rows of windows", (step, Ho, W, M), self.values.dtype)
        for i in range(self.g.kernel[0]):
            first = i * self.g.dilation[0]
            under = self.values[:, first : first + (Ho - 1) * self.g.stride[0] + 1 : self.g.stride[0]]
            if i == 0:
                over[...] = under
            else:
                op(over, under, out=over)
        by_row = over.reshape(step, Ho, -1)
        for j in range(self.g.kernel[1]):
            column, phase = divmod(j * self.g.dilation[1], step)
            vector = by_row[phase, :, column * M : (column + Wo) * M]
            if j == 0:
                out[...] = vector
            else:
                op(out, vector, out=out)
        return out


def shape_of(g: Geometry, sizes: Pair, outputs: Pair) -> tuple[int, int, int]:
    """The shape (sw, H, W) of a map with its padding, and all of the windows that extend beyond it."""
    high, wide = (
        max(n + 2 * p, (o - 1) * s + d * (k - 1) + 1)
        for n, o, k, s, p, d in zip(sizes, outputs, g.kernel, g.stride, g.pad, g.dilation)
    )
    step = g.stride[1]
    return step, high, max(-(-wide // step), outputs[1] + g.dilation[1] * (g.kernel[1] - 1) // step)
