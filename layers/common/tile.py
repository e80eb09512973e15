"""Tile: repeat a blob along an axis.

bottom[0]  x  (..., S, ...)        S values along ``axis``
top[0]     y  (..., tiles S, ...)  x repeated

dx = sum of the repeated parts of dy
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from netlib.blob import Blobs
from netlib.layer import Layer
from netlib.proto.schema import numbered


@dataclass(frozen=True)
class TileParameter:
    """The ``tile_param { ... }`` block."""

    tiles: int = numbered(2)  # number of copies
    axis: int = numbered(1, 1)


class Tile(Layer):
    """Repeats a blob."""

    param: TileParameter
    bottoms = tops = (1, 1)
    in_place = False

    def setup(self, bottom: Blobs, top: Blobs) -> None:
        if self.param.tiles < 1:
            raise self.fail(f"tiles {self.param.tiles} must be at least 1", "tiles")

    def reshape(self, bottom: Blobs, top: Blobs) -> None:
        shape = list(bottom[0].shape)
        self.axis = self.canonical_axis(self.param.axis, bottom[0])
        shape[self.axis] *= self.param.tiles
        top[0].reshape(shape)

    def forward(self, bottom: Blobs, top: Blobs) -> None:
        x = bottom[0].data
        top[0].data.reshape(self._apart(bottom))[...] = np.expand_dims(x, self.axis)

    def backward(self, top: Blobs, propagate_down: list[bool], bottom: Blobs) -> None:
        if propagate_down[0]:
            bottom[0].diff[...] = top[0].diff.reshape(self._apart(bottom)).sum(axis=self.axis)

    def _apart(self, bottom: Blobs) -> tuple[int, ...]:
        """Shape of the top with a separate axis for the tiles."""
        shape = bottom[0].shape
        return (*shape[: self.axis], self.param.tiles, *shape[self.axis :])
