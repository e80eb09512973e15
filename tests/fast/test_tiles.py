"""Blobs in tiles."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from fast.tiles import tile_into, tiles_of
from netlib.blob import Blob
from tests.support.tiled import load, store, tiled


def test_tiles_store_each_value_at_its_documented_index() -> None:
    """The value of row h, column w, channel c, image n is at [h, w % T, c, n, w // T]."""
    N, C, H, W, T = 2, 3, 5, 7, 3
    x = np.arange(N * C * H * W, dtype=np.float32).reshape(N, C, H, W)
    blob = tiled(x.shape, T)
    assert blob.storage_shape == (6, 3, 3, 2, 3)
    tile_into(x, T, blob.data)
    for n, c, h, w in np.ndindex(*x.shape):
        assert blob.data[h, w % T, c, n, w // T] == x[n, c, h, w]


@given(
    shape=st.tuples(*[st.integers(1, 3)] * 2, *[st.integers(1, 9)] * 2),
    one=st.integers(1, 5),
    other=st.integers(1, 5),
    spare=st.integers(0, 2),
)
def test_tiles_and_back(shape: tuple[int, ...], one: int, other: int, spare: int) -> None:
    """Converting plain arrays to tiles, to other tiles and back keeps the values, also for sizes
    not divisible by T.
    """
    x = np.random.default_rng(0).normal(size=shape)
    first, second = tiled(shape, one, spare), tiled(shape, other)
    store(first, "data", x)
    tiles_of(first, first.data, other, second.pitch, second.data)
    assert np.array_equal(load(first, "data"), x)
    if (first.tile, first.pitch) != (second.tile, second.pitch):  # else nothing is copied
        assert np.array_equal(load(second, "data"), x)


def test_tiles_of_the_same_kind_are_not_copied() -> None:
    blob = tiled((2, 3, 4, 4), 2)
    out = np.empty(blob.storage_shape)
    assert tiles_of(blob, blob.data, 2, blob.pitch, out) is blob.data
    assert tiles_of(Blob(blob.shape), np.ones(blob.shape), 2, blob.pitch, out) is out
