"""FastPooling: pooling by running maxima and sums (map_pooling.py), or on tiles (max_tiles.py).

Tiles (tiles.py) are for adjacent square windows of a blob that a convolution writes as tiles, as in
the hand network. A window over the whole map is one reduction.
"""

from __future__ import annotations

import math

import numpy as np

from fast import map_pooling
from fast.fast_layer import FastLayer
from fast.geometry import Geometry
from fast.max_tiles import MaxTiles
from fast.tiles import pitch_of, tile_of
from layers.vision.pooling import NOTHING, Pooling
from netlib.blob import Array, Blobs


class FastPooling(FastLayer, Pooling):
    """Pooling over any windows."""

    def setup(self, bottom: Blobs, top: Blobs) -> None:
        """Read the options."""
        super().setup(bottom, top)
        self.layout: tuple[object, ...] = ()  # of the blobs in the last reshape
        self.tile = MaxTiles.tile_for(self, len(top))
        self.tiles: MaxTiles | None = None

    def takes_maximum(self) -> bool:
        """Whether the layer is max pooling without empty windows, and without a mask, which would
        depend on a layer that is moved.
        """
        is_full = all(stride <= kernel for stride, kernel in zip(self.stride, self.kernel))
        return self.is_max and is_full and len(self.spec.top) == 1

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
        """Reshape the tops and select an algorithm.

        The winners are kept if the layout has not changed.
        """
        super().reshape(bottom, top)
        x, y = bottom[0], top[0]
        layout = x.shape, tile_of(x), pitch_of(x), tile_of(y)
        if layout == self.layout:
            return
        self.tiles = None
        if self.tile is not None and (tile_of(x) is not None or tile_of(y) is not None):
            self.tiles = MaxTiles(self, self.tile, x, y)
        (_, _, H, W), (_, _, Ho, Wo) = x.shape, y.shape
        geometry = Geometry(self.kernel, self.stride, self.pad, (1, 1), 1)
        self.map_windows = map_pooling.Windows(geometry, (H, W), (Ho, Wo))
        if self.is_max:
            dtype = np.uint8 if math.prod(self.kernel) < 256 else np.uint32
            self.winners = np.empty(0 if self.tiles else y.shape, dtype)
        else:
            self.areas = self.area(x.shape, y.shape)
        self.layout = layout  # last, so that an interrupted reshape is repeated

    def forward(self, bottom: Blobs, top: Blobs) -> None:
        """Compute the maxima and the winners, or the means."""
        if self.tiles is not None:
            self.tiles.forward(bottom[0], top[0])
            return
        x, y = bottom[0].data, top[0].data
        if not self.is_max:
            self._forward_means(x, y)
            return
        self._forward_maxima(x, y, with_winners=self.needs_backward or len(top) > 1)
        if len(top) > 1:
            for n in range(len(x)):
                winners = self._index(n, x.shape[3])
                top[1].data[n] = np.where(y[n] == NOTHING, -1, winners)

    def _forward_means(self, x: Array, y: Array) -> None:
        if self.map_windows.is_whole:
            ones = np.ones(self.kernel[0] * self.kernel[1], x.dtype)
            np.matmul(_flat(x), ones, out=y.reshape(-1))
            y /= self.areas
        else:
            map_pooling.mean(self.map_windows, _maps(x), _maps(y), self.areas)

    def _forward_maxima(self, x: Array, y: Array, with_winners: bool) -> None:
        if not self.map_windows.is_whole:
            winners = _maps(self.winners) if with_winners else None
            map_pooling.maximum(self.map_windows, _maps(x), _maps(y), winners)
            return
        if with_winners:
            self.winners = _flat(x).argmax(axis=1).reshape(y.shape)
        np.maximum(_flat(x).max(axis=1), y.dtype.type(NOTHING), out=y.reshape(-1))

    def backward(self, top: Blobs, propagate_down: list[bool], bottom: Blobs) -> None:
        """Write the gradient of each top value to its winner, or to all of its window."""
        if not propagate_down[0]:
            return
        if self.tiles is not None:
            self.tiles.backward(top[0], bottom[0])
            return
        dy, dx = top[0].diff, bottom[0].diff
        if not self.is_max and self.map_windows.is_whole:
            dx[...] = dy / self.areas
        elif not self.is_max:
            map_pooling.mean_backward(self.map_windows, _maps(dy), _maps(dx), self.areas)
        else:
            map_pooling.maximum_backward(
                self.map_windows, _maps(dy), _maps(self.winners), _maps(dx)
            )


def _maps(array: Array) -> Array:
    """View (N, C, H, W) as N C maps."""
    return array.reshape(array.shape[0] * array.shape[1], *array.shape[2:])


def _flat(array: Array) -> Array:
    """View (N, C, H, W) as N C rows."""
    N, C, H, W = array.shape
    return array.reshape(N * C, H * W)
