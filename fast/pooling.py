"""FastPooling: max pooling over adjacent square windows on tiles (max_tiles.py), as in the hand network.

For a single window over the whole map it uses one argmax. Other options are computed by the plain layer.
"""

from __future__ import annotations

import math

from fast.fast_layer import FastLayer
from fast.max_tiles import MaxTiles
from fast.tiles import pitch_of, tile_of
from layers.vision.pooling import Pooling
from netlib.blob import Blob, Blobs

Layout = tuple[tuple[int, ...], int | None, int]  # shape, tile and pitch of a blob
MAX_TILE = 15  # the index of a winner must fit in a byte


class FastPooling(FastLayer, Pooling):
    """Max pooling computed on tiles."""

    def setup(self, bottom: Blobs, top: Blobs) -> None:
        """Read the options and select tiles or the plain layer."""
        super().setup(bottom, top)
        k = self.kernel[0]
        side_by_side = self.kernel == self.stride == (k, k) and self.pad == (0, 0) and self.param.round_mode == "CEIL"
        self.fits = self.is_max and len(top) == 1  # the plain layer writes a mask
        self.layout: list[Layout] = []
        self.tile = k if self.fits and side_by_side and 1 < k <= MAX_TILE else None

    def bottom_tile(self, top_tile: int | None) -> int | None:
        """The size of a window, or None for the plain layer."""
        return self.tile

    def writes_tiles(self) -> bool:
        """Whether the layer is computed on tiles; it writes tiles of any size."""
        return self.tile is not None

    def reads_sparse(self) -> bool:
        """Whether the bottom can be sparse: the maximum of a constant window is its value."""
        return self.tile is not None

    def reshape(self, bottom: Blobs, top: Blobs) -> None:
        """Reshape the top. The winners of the last pass are kept if the layout has not changed."""
        super().reshape(bottom, top)
        if self.tile and _layout(bottom[0], top[0]) != self.layout:
            self.tiles = MaxTiles(self, self.tile, bottom[0], top[0])
            self.layout = _layout(bottom[0], top[0])  # after MaxTiles has set the pitch of the top

    def forward(self, bottom: Blobs, top: Blobs) -> None:
        """Compute the maxima and the winners."""
        if self.tile:
            self.tiles.forward(bottom[0], top[0])
        elif self.fits and self.kernel == bottom[0].shape[2:] and self.pad == (0, 0):
            flat = bottom[0].data.reshape(*bottom[0].shape[:2], math.prod(self.kernel))  # -1 fails for 0 items
            self.winners = flat.argmax(axis=2)[..., None, None]
            top[0].data[...] = flat.max(axis=2)[..., None, None]
        else:
            super().forward(bottom, top)

    def backward(self, top: Blobs, propagate_down: list[bool], bottom: Blobs) -> None:
        """Write the gradient of each top value to its winner."""
        if self.tile and propagate_down[0]:
            self.tiles.backward(top[0], bottom[0])
        elif not self.tile:
            super().backward(top, propagate_down, bottom)


def _layout(*blobs: Blob) -> list[Layout]:
    return [(blob.shape, tile_of(blob), pitch_of(blob)) for blob in blobs]
