"""Blobs of the fast engine: in tiles, adopted, cleared lazily."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fast.tiles import FastBlob, LazilyCleared, tile_into, tiles_of
from netlib.blob import Blob
from tests.support.tiled import load, store, tiled


def lazy(*shape: int) -> LazilyCleared:
    """A parameter of ones."""
    return LazilyCleared(shape, np.float32, np.ones(shape, np.float32))


@pytest.mark.parametrize("links", [0, 1, 2])
def test_a_lazily_cleared_diff_is_zero_for_whoever_looks(links: int) -> None:
    """Though its memory is only filled then; who adds to it is told that writing will do, once. Also through shares."""
    owner = blob = lazy(2, 3)
    for _ in range(links):
        blob, shared = lazy(6), blob
        blob.share(shared)
    blob.diff[...] = 5
    blob.clear()
    diff, is_zero = blob.to_add_to()
    assert is_zero
    diff[...] = 7
    assert not blob.to_add_to()[1]
    assert (owner.diff == 7).all()
    blob.clear()
    assert not owner.diff.any()
    assert not blob.to_add_to()[1]
    assert (owner.data == 1).all()


def test_a_diff_that_somebody_keeps_is_cleared_at_once() -> None:
    """And goes on to be the blob's."""
    blob = lazy(2, 3)
    kept = blob.diff
    kept[...] = 5
    blob.clear()
    assert not kept.any()
    diff, is_zero = blob.to_add_to()
    diff += 2
    assert kept.tolist() == [[2, 2, 2], [2, 2, 2]] and not is_zero
    row = blob.diff[0]
    del kept, diff
    blob.clear()
    assert not row.any()


def test_adopt_takes_an_array_of_the_right_kind_only() -> None:
    """Without a copy."""
    blob, array = FastBlob((2, 3)), np.ones((2, 3), np.float32)
    blob.adopt(array)
    assert blob.data is array
    for wrong in (np.ones((3, 2), np.float32), np.ones((2, 3))):
        with pytest.raises(ValueError, match="expected an array"):
            blob.adopt(wrong)


def test_where_a_value_stands_in_tiles() -> None:
    """Row h, column w, channel c, image n at [h, w % T, c, n, w // T]."""
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
    """Plain to tiles, to other tiles, to plain: the same values, for sizes that do not divide too."""
    x = np.random.default_rng(0).normal(size=shape)
    first, second = tiled(shape, one, spare), tiled(shape, other)
    store(first, "data", x)
    tiles_of(first, first.data, other, second.pitch, second.data)
    assert np.array_equal(load(first, "data"), x)
    if (first.tile, first.pitch) != (second.tile, second.pitch):  # else there is nothing to copy
        assert np.array_equal(load(second, "data"), x)


def test_tiles_of_the_same_kind_are_not_copied() -> None:
    """A layer that wants what is there gets it."""
    blob = tiled((2, 3, 4, 4), 2)
    out = np.empty(blob.storage_shape)
    assert tiles_of(blob, blob.data, 2, blob.pitch, out) is blob.data
    assert tiles_of(Blob(blob.shape), np.ones(blob.shape), 2, blob.pitch, out) is out
