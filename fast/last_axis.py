"""Maps with the number of the map as last axis, so that the values under an element of a window
are long vectors.

    values (sw, H, W, M)    column v of a padded map is at [v % sw, ..., v // sw, :], for a
                            horizontal stride sw

For a row of outputs, the values under an element of all windows of all maps are one vector of Wo M
adjacent values, for any stride.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import lru_cache

import cv2
import numpy as np

from fast.geometry import Geometry
from fast.parallel import scratch
from netlib.blob import Array, divide_up

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
        bottom = top + len(by_place)
        for v in range(step):
            inside = by_place[:, (v - left) % step :: step]
            first = divide_up(left - v, step)
            end = first + inside.shape[1]
            yield inside, self.values[v, top:bottom, first:end]

    def read(self, x: Array) -> None:
        """Copy x (M, H, W) to the maps."""
        by_place = scratch("by place", (*x.shape[1:], len(x)), x.dtype)
        map_last(x, by_place)
        for inside, places in self._phases(by_place):
            places[...] = inside

    def write(self, x: Array) -> None:
        """Copy the maps to x (M, H, W)."""
        by_place = scratch("by place", (*x.shape[1:], len(x)), x.dtype)
        for inside, places in self._phases(by_place):
            inside[...] = places
        map_first(by_place, x)

    def vectors(self, rows: slice | None = None) -> Iterator[tuple[tuple[int, ...], Array]]:
        """For each element of a window, the values under it for these rows of
        outputs, (rows, Wo M).
        """
        start, stop = (rows.start, rows.stop) if rows else (0, self.outputs[0])
        (step, H, _, M), down = self.values.shape, self.g.stride[0]
        length, height = self.outputs[1] * M, (stop - start) * down
        phases = list(self.values.reshape(step, H, -1))
        for i in range(self.g.kernel[0]):
            first = start * down + i * self.g.dilation[0]
            end = first + height
            for j in range(self.g.kernel[1]):
                column, phase = divmod(j * self.g.dilation[1], step)
                left = column * M
                yield (i, j), phases[phase][first:end:down, left : left + length]


def map_last(x: Array, out: Array) -> None:
    """Copy x (M, H, W) to out (H, W, M), by blocks that stay in the cache."""
    cv2.transpose(x.reshape(len(x), -1), out.reshape(-1, len(x)))


def map_first(x: Array, out: Array) -> None:
    """Copy x (H, W, M) to out (M, H, W), of which each map is contiguous, by blocks that
    stay in the cache.
    """
    rows = np.lib.stride_tricks.as_strided(
        out, (len(out), out[0].size), (out.strides[0], out.itemsize)
    )
    cv2.transpose(x.reshape(-1, len(out)), rows)


@lru_cache(maxsize=256)
def shape_of(g: Geometry, sizes: Pair, outputs: Pair) -> tuple[int, int, int]:
    """The shape (sw, H, W) of a map with its padding, and all of the windows that
    extend beyond it.
    """
    high, wide = map(max, g.padded(sizes), g.extent(outputs))
    step = g.stride[1]
    columns = max(divide_up(wide, step), outputs[1] + g.reach[1] // step)
    return step, high, columns
