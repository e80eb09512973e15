"""FastPooling: pooling by running maxima and sums (map_pooling.py), or on tiles (max_tiles.py).

Tiles are for adjacent square windows of a blob that a convolution writes as tiles, as in the hand network. A window
over the whole map is one reduction.
"""

from __future__ import annotations

import numpy as np

from fast.fast_layer import FastLayer
from fast.geometry import Geometry
from fast.map_pooling import MaxOfMaps, MeanOfMaps, Windows
from fast.max_tiles import MaxTiles
from fast.tiles import pitch_of, tile_of
from layers.vision.pooling import NOTHING, Pooling
from netlib.blob import Array, Blob, Blobs

Layout = tuple[tuple[int, ...], int | None, int]  # shape, tile and pitch of a blob


class FastPooling(FastLayer, Pooling):
    """Pooling over any windows."""

    def setup(self, bottom: Blobs, top: Blobs) -> None:
        """Read the options."""
        super().setup(bottom, top)
        self.layout: list[Layout] = []
        self.tile = MaxTiles.tile(self, len(top))
        self.tiles: MaxTiles | None = None

    def bottom_tile(self, top_tile: int | None) -> int | None:
        """The size of a window, or None for other algorithms."""
        return self.tile

    def writes_tiles(self) -> bool:
        """Whether the layer can be computed on tiles; it then writes tiles of any size."""
        return self.tile is not None

    def reads_sparse(self) -> bool:
        """Whether the bottom can be sparse: the maximum of a constant window is its value."""
        return self.tile is not None

    def reshape(self, bottom: Blobs, top: Blobs) -> None:
        """Reshape the tops and select an algorithm. The winners are kept if the layout has not changed."""
        super().reshape(bottom, top)
        x, y = bottom[0], top[0]
        if _layout(x, y) == self.layout:
            return
        on_tiles = self.tile is not None and (tile_of(x) is not None or tile_of(y) is not None)
        self.tiles = MaxTiles(self, self.tile, x, y) if on_tiles and self.tile else None
        (_, _, H, W), (_, _, Ho, Wo) = x.shape, y.shape
        self.over = Windows(Geometry(self.kernel, self.stride, self.pad, (1, 1), 1), (H, W), (Ho, Wo))
        if self.is_max:
            self.winners = np.empty(0 if on_tiles else y.shape, MaxOfMaps.winner_type(self.over))
        else:
            self.areas = self.area(x.shape, y.shape)
        self.layout = _layout(x, y)  # after MaxTiles has set the pitch of the top

    def forward(self, bottom: Blobs, top: Blobs) -> None:
        """Compute the maxima and the winners, or the means."""
        if self.tiles is not None:
            self.tiles.forward(bottom[0], top[0])
            return
        x, y = bottom[0].data, top[0].data
        if not self.is_max:
            if self.over.is_whole:
                np.matmul(_flat(x), np.ones(self.kernel[0] * self.kernel[1], x.dtype), out=y.reshape(-1))
                y /= self.areas
            else:
                MeanOfMaps().forward(self.over, _maps(x), _maps(y), self.areas)
            return
        masks = len(top) > 1
        wanted = self.needs_backward or masks
        if self.over.is_whole:
            if wanted:
                self.winners = _flat(x).argmax(axis=1).reshape(y.shape)
            np.maximum(_flat(x).max(axis=1), y.dtype.type(NOTHING), out=y.reshape(-1))
        else:
            MaxOfMaps().forward(self.over, _maps(x), _maps(y), _maps(self.winners) if wanted else None)
        for n in range(len(x) if masks else 0):
            top[1].data[n] = np.where(y[n] == NOTHING, -1, self._index(n, x.shape[3]))

    def backward(self, top: Blobs, propagate_down: list[bool], bottom: Blobs) -> None:
        """Write the gradient of each top value to its winner, or to all of its window."""
        if not propagate_down[0]:
            return
        if self.tiles is not None:
            self.tiles.backward(top[0], bottom[0])
            return
        dy, dx = top[0].diff, bottom[0].diff
        if not self.is_max and self.over.is_whole:
            dx[...] = dy / self.areas
        elif not self.is_max:
            MeanOfMaps().backward(self.over, _maps(dy), _maps(dx), self.areas)
        else:
            MaxOfMaps().backward(self.over, _maps(dy), _maps(self.winners), _maps(dx))


def _maps(array: Array) -> Array:
    """View (N, C, H, W) as N C maps."""
    return array.reshape(array.shape[0] * array.shape[1], *array.shape[2:])


def _flat(array: Array) -> Array:
    """View (N, C, H, W) as N C rows."""
    N, C, H, W = array.shape
    return array.reshape(N * C, H * W)


def _layout(*blobs: Blob) -> list[Layout]:
    return [(blob.shape, tile_of(blob), pitch_of(blob)) for blob in blobs]
