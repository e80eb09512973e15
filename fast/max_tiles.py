"""MaxTiles: max pooling with adjacent T x T windows, from or to a blob in tiles (tiles.py).

The T T values of a window are in T T slabs, each contiguous over channels, images and the windows
of a row, so the maximum is computed between long vectors, and a winner is a small integer.

The bottom may be sparse: only some windows are stored. All others have one constant value, which is
their maximum, and the winner is their first element.
"""

from __future__ import annotations

import functools

import numpy as np

from fast.fast_layer import FastLayer
from fast.tiles import (
    FastBlob,
    SparseTiles,
    pitch_of,
    sparse_of,
    store_plain,
    tile_of,
    tiles_of,
    untile,
)
from layers.vision.pooling import NOTHING, Pooling
from netlib.blob import Array, Blob, divide_up

MAX_TILE = 15  # the index of a winner must fit in a byte


class MaxTiles:
    """Max pooling of one layer from one blob to another, with the winners between forward and
    backward.

    winners   (R, L) for R rows of L = C N P windows: row-major index in the window. Those of a
              sparse bottom are in ``SparseTiles.winner``
    """

    @staticmethod
    def tile_for(layer: Pooling, tops: int) -> int | None:
        """T if the windows are adjacent T x T squares that reach beyond the map's end, without a
        mask; else None.
        """
        T = layer.kernel[0]
        are_adjacent = layer.kernel == layer.stride == (T, T) and not any(layer.pad)
        if not layer.is_max or tops > 1 or not are_adjacent:
            return None
        return T if layer.param.round_mode == "CEIL" and 1 < T <= MAX_TILE else None

    def __init__(self, layer: FastLayer, T: int, bottom: Blob, top: Blob) -> None:
        self.layer, self.T = layer, T
        N, C, H, W = bottom.shape
        # Windows stored per row.
        self.columns = pitch_of(bottom) // T if tile_of(bottom) == T else divide_up(W, T)
        if isinstance(top, FastBlob) and top.tile is not None:
            top.pitch = divide_up(self.columns, top.tile) * top.tile
        self.R, self.L = divide_up(H, T), C * N * self.columns
        # Of equal values the first is the winner: it has the highest rank.
        self.rank = np.arange(T * T, 0, -1, dtype=np.uint8)[:, None]
        self.winners = np.empty((self.R, self.L), np.uint8)

    def forward(self, bottom: Blob, top: Blob) -> None:
        """Write the data of the top."""
        if (sparse := sparse_of(bottom)) is not None:
            self._forward_sparse(sparse, top)
            return
        T, (N, C, H, W) = self.T, bottom.shape
        storage = (self.R * T, T, C, N, self.columns)
        out = bottom.data if tile_of(bottom) == T else self.layer.buffer("x", storage)
        x = tiles_of(bottom, bottom.data, T, self.columns * T, out)
        self._fill_overhang(x, H, W, -np.inf)  # never the maximum
        slabs = x.reshape(self.R, T * T, self.L)
        y = self._rows(top, top.data)
        maximum = np.max(slabs, axis=1, out=y.reshape(self.R, self.L))
        if self.layer.needs_backward:
            self._find_winners(slabs, maximum[:, None], self.winners)
        np.maximum(maximum, NOTHING, out=maximum)
        # finite, because the backward of a layer in place multiplies by it
        self._fill_overhang(x, H, W, 0)
        y[..., divide_up(W, T) :] = 0  # windows that are only padding
        if not self._is_rows(top):
            store_plain(top, untile(y[:, None], *top.shape[2:]), top.data)

    def backward(self, top: Blob, bottom: Blob) -> None:
        """Write the diff of the bottom."""
        if (sparse := sparse_of(bottom)) is not None:
            self._backward_sparse(top, sparse)
            return
        T, (N, C, H, W) = self.T, bottom.shape
        dy = self._rows(top, top.diff)
        if not self._is_rows(top):
            tiles_of(top, top.diff, 1, self.columns, dy[:, None])
        direct = tile_of(bottom) == T
        dx = bottom.diff if direct else self.layer.buffer("dx", (self.R * T, T, C, N, self.columns))
        dx.fill(0)
        index = self.winners.astype(np.intp)  # position of each winner in dx
        index *= self.L
        first_of_row = np.arange(self.R) * (T * T * self.L)
        index += first_of_row[:, None] + np.arange(self.L)
        dx.reshape(-1)[index.reshape(-1)] = dy.reshape(-1)
        if not direct:
            bottom.diff[...] = untile(dx, H, W)

    def _fill_overhang(self, x: Array, H: int, W: int, value: float) -> None:
        """Set the elements of windows beyond the edge of the image."""
        x[H:] = value
        if W % self.T:
            x[:, W % self.T :, ..., W // self.T] = value

    def _find_winners(self, slabs: Array, maximum: Array, winners: Array) -> None:
        """Write the index of the first maximum of (..., T T, L) values to ``winners``."""
        first = self.layer.buffer("first", slabs.shape, np.uint8)
        np.equal(slabs, maximum, out=first.view(bool))
        first *= self.rank
        np.subtract(np.uint8(len(self.rank)), first.max(axis=-2), out=winners)
        unknown = winners == len(self.rank)  # no value equals a NaN maximum
        if unknown.any():
            first_nan = np.isnan(slabs).argmax(axis=-2)
            np.copyto(winners, first_nan, casting="unsafe", where=unknown)

    # The top as rows of windows, (R, C, N, P): its own array if it has this layout, else a buffer.

    def _is_rows(self, top: Blob) -> bool:
        return tile_of(top) == 1 and pitch_of(top) == self.columns

    def _rows(self, top: Blob, array: Array) -> Array:
        shape = (self.R, top.shape[1], top.shape[0], self.columns)
        return array.reshape(shape) if self._is_rows(top) else self.layer.buffer("rows", shape)

    # --------------------------------------------------------------------------------------- sparse

    def _forward_sparse(self, x: SparseTiles, top: Blob) -> None:
        places, C, A = x.values.shape
        slabs = x.values.reshape(places, C * A)
        maximum = slabs.max(axis=0)
        if self.layer.needs_backward:
            winners = np.empty(C * A, np.uint8)
            self._find_winners(slabs, maximum, winners)
            x.winner = winners.reshape(C, A)
        maximum.reshape(C, A)[...] += x.bias[:, None]
        y = self._tiles(top, top.data)
        y[...] = x.rest[:, None, None]
        y.reshape(-1)[self._index(y, x, top)] = maximum
        np.maximum(y, NOTHING, out=y)
        if tile_of(top) is None:
            top.data[...] = untile(y, *top.shape[2:])

    def _backward_sparse(self, top: Blob, x: SparseTiles) -> None:
        dy = self._tiles(top, top.diff)
        if tile_of(top) is None:
            tiles_of(top, top.diff, 1, dy.shape[-1], dy)
        x.diff = dy.reshape(-1)[self._index(dy, x, top)].reshape(dy.shape[2], -1)
        of_all = dy.sum(axis=(0, 1, 3, 4), dtype=np.float64)
        of_stored = x.diff.sum(axis=1, dtype=np.float64)
        x.rest_diff = (of_all - of_stored).astype(dy.dtype)

    def _tiles(self, top: Blob, array: Array) -> Array:
        """The top as tiles: its own array if tiled, else a buffer for tiles of size 1."""
        N, C, Ho, Wo = top.shape
        return array if tile_of(top) else self.layer.buffer("top", (Ho, 1, C, N, Wo))

    def _index(self, tiles: Array, x: SparseTiles, top: Blob) -> Array:
        """Flat index (C A,) of every channel and stored window in the top as tiles
        (R, T, C, N, P).
        """
        _, T, C, N, P = tiles.shape
        first = _places(N, *top.shape[2:], T, C, P)[x.window]
        return (np.arange(C)[:, None] * (N * P) + first).reshape(-1)


@functools.lru_cache(maxsize=16)
def _places(N: int, rows: int, columns: int, T: int, C: int, P: int) -> Array:
    """Flat index of the first channel of each window in tiles (rows, T, C, N, P)."""
    image, row, column = np.indices((N, rows, columns)).reshape(3, -1)
    t, phase = np.divmod(column, T)
    slab = row * T + phase
    return np.asarray((slab * (C * N) + image) * P + t)
