"""Blobs in tiles for tests, and functions to write and read them in the plain order."""

from functools import cached_property

import numpy as np

from fast.tiles import FastBlob, tile_into, untile


class TiledBlob(FastBlob):
    """A blob stored in tiles, as in a slice."""

    @cached_property
    def data(self):
        return np.zeros(self.storage_shape, self.dtype)

    @cached_property
    def diff(self):
        return np.zeros(self.storage_shape, self.dtype)


def tiled(shape, tile, spare=0, dtype=np.float64):
    """Return a blob of this shape, in tiles of ``tile`` with spare windows in each row; plain if
    ``tile`` is None.
    """
    blob = TiledBlob(shape, dtype)
    if tile is not None:
        blob.tile, blob.pitch = tile, (-(-shape[3] // tile) + spare) * tile
    return blob


def store(blob, half, values):
    """Write values (N, C, H, W) in the blob's own order."""
    if blob.tile is None:
        getattr(blob, half)[...] = values
    else:
        tile_into(values, blob.tile, getattr(blob, half))


def load(blob, half):
    """Return the values as (N, C, H, W)."""
    array = getattr(blob, half)
    return array if blob.tile is None else untile(array, *blob.shape[2:])


def check_padding(blob):
    """Check what tiles.py states of the padding of tiles: finite in data, zero in diff."""
    if blob.tile is not None:
        values = np.zeros(blob.storage_shape, blob.dtype)
        tile_into(load(blob, "diff"), blob.tile, values)
        assert np.array_equal(blob.diff, values)
        assert np.isfinite(blob.data).all()
