"""FastPooling: the maximum over square windows side by side, as the hand network has it, on tiles (max_tiles.py).

A single window over the whole map is one argmax. Other options are the plain layer's.
"""

from __future__ import annotations

import math

from fast.fast_layer import FastLayer
from fast.max_tiles import MaxTiles
from fast.tiles import pitch_of, tile_of
from layers.vision.pooling import Pooling
from netlib.blob import Blob, Blobs

Layout = tuple[tuple[int, ...], int | None, int]  # of a blob: shape, tile, pitch
MAX_TILE = 15  # a winner is a byte


class FastPooling(FastLayer, Pooling):
    """Max pooling on tiles."""

    def setup(self, bottom: Blobs, top: Blobs) -> None:
        """Choose between tiles and the plain layer."""
        super().setup(bottom, top)
        k = self.kernel[0]
        side_by_side = self.kernel == self.stride == (k, k) and self.pad == (0, 0) and self.param.round_mode == "CEIL"
        self.fits = self.is_max and len(top) == 1  # the plain layer writes a mask
        self.layout: list[Layout] = []
        self.tile = k if self.fits and side_by_side and 1 < k <= MAX_TILE else None

    def bottom_tile(self, top_tile: int | None) -> int | None:
        """One tile is one window."""
        return self.tile

    def writes_tiles(self) -> bool:
        """Of any size."""
        return self.tile is not None

    def reads_sparse(self) -> bool:
        """Windows that hold one value have it as their maximum."""
        return self.tile is not None

    def reshape(self, bottom: Blobs, top: Blobs) -> None:
        """Lay out the windows; where none has moved, the winners of the last pass stay."""
        super().reshape(bottom, top)
        if self.tile and _layout(bottom[0], top[0]) != self.layout:
            self.tiles = MaxTiles(self, self.tile, bottom[0], top[0])
            self.layout = _layout(bottom[0], top[0])  # of which the tiles have set the top's pitch

    def forward(self, bottom: Blobs, top: Blobs) -> None:
        """Maximum and winners."""
        if self.tile:
            self.tiles.forward(bottom[0], top[0])
        elif self.fits and self.kernel == bottom[0].shape[2:] and self.pad == (0, 0):
            flat = bottom[0].data.reshape(*bottom[0].shape[:2], math.prod(self.kernel))  # there may be no items
            self.winners = flat.argmax(axis=2)[..., None, None]
            top[0].data[...] = flat.max(axis=2)[..., None, None]
        else:
            super().forward(bottom, top)

    def backward(self, top: Blobs, propagate_down: list[bool], bottom: Blobs) -> None:
        """To the winners."""
        if self.tile and propagate_down[0]:
            self.tiles.backward(top[0], bottom[0])
        elif not self.tile:
            super().backward(top, propagate_down, bottom)


def _layout(*blobs: Blob) -> list[Layout]:
    return [(blob.shape, tile_of(blob), pitch_of(blob)) for blob in blobs]
