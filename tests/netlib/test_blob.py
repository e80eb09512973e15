"""Blob: data and diff of one shape, in the plain order or in tiles."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from netlib.blob import Blob, Blobs, plain_of, tiles_of


def test_a_new_blob_is_zero() -> None:
    """Data and diff, of the given type."""
    blob = Blob((2, 3), np.float64)
    assert blob.data.tolist() == blob.diff.tolist() == [[0, 0, 0], [0, 0, 0]]
    assert blob.data.dtype == np.float64
    assert (blob.count, Blob(()).count, Blob((3, 0)).count) == (6, 1, 0)


def test_reshape_takes_numbers_or_a_shape_and_forgets_values_only_with_a_new_shape() -> None:
    """As Caffe's Python interface does."""
    blob = Blob((2, 3))
    blob.data[...] = 5
    blob.reshape(2, 3)
    assert (blob.data == 5).all()
    blob.reshape((3, 2))
    assert blob.shape == (3, 2)
    assert not blob.data.any()
    blob.reshape(())
    assert blob.data.shape == ()
    with pytest.raises(ValueError, match=r"cannot have the shape \(2, -1\)"):
        blob.reshape(2, -1)


def test_a_cleared_diff_is_filled_with_zeros() -> None:
    """At once: somebody may hold the array."""
    blob = Blob((2, 3))
    held = blob.diff
    held[...] = 5
    blob.clear_diff()
    assert not held.any()
    assert not blob.diff_to_add_to()[1]


@pytest.mark.parametrize("links", [0, 1, 2])
def test_a_lazily_cleared_diff_is_zero_for_whoever_looks(links: int) -> None:
    """Though its memory is only filled then; who adds to it is told that writing will do, once. Also through shares."""
    owner = blob = Blob((2, 3))
    owner.lazily_cleared = True
    for _ in range(links):
        blob, shared = Blob((6,)), blob
        blob.share(shared)
    blob.diff[...] = 5
    blob.clear_diff()
    diff, is_zero = blob.diff_to_add_to()
    assert is_zero
    diff[...] = 7
    assert not blob.diff_to_add_to()[1]
    assert (owner.diff == 7).all()
    blob.clear_diff()
    assert not owner.diff.any()
    assert not blob.diff_to_add_to()[1]


def test_caffes_names_of_the_axes() -> None:
    """Missing axes have size 1."""
    blob = Blob((5, 4, 3))
    assert (blob.num, blob.channels, blob.height, blob.width) == (5, 4, 3, 1)
    assert repr(blob) == "<Blob 5x4x3 float32>"
    assert repr(Blob(())) == "<Blob scalar float32>"


def test_adopt_takes_an_array_of_the_right_kind_only() -> None:
    """Without a copy."""
    blob, array = Blob((2, 3)), np.ones((2, 3), np.float32)
    blob.adopt(array)
    assert blob.data is array
    for wrong in (np.ones((3, 2), np.float32), np.ones((2, 3))):
        with pytest.raises(ValueError, match="expected an array"):
            blob.adopt(wrong)


def test_add_blob_makes_a_parameter() -> None:
    """Of the list's type: how a Caffe Python layer makes its parameters."""
    blobs = Blobs(dtype=np.float64)
    assert blobs.add_blob(2, 3) is blobs[0]
    assert (blobs[0].shape, blobs[0].data.dtype) == ((2, 3), np.float64)


# ---------------------------------------------------------------------------------------------- tiles


def tiled(shape: tuple[int, ...], tile: int, spare: int = 0) -> Blob:
    """A tiled blob with so many spare windows a row."""
    blob = Blob(shape)
    blob.tile, blob.pitch = tile, (-(-shape[3] // tile) + spare) * tile
    return blob


def test_where_a_value_stands_in_tiles() -> None:
    """Row h, column w, channel c, image n at [h, w % T, c, n, w // T]."""
    N, C, H, W, T = 2, 3, 5, 7, 3
    x = np.arange(N * C * H * W, dtype=np.float32).reshape(N, C, H, W)
    blob = tiled(x.shape, T)
    assert blob.storage_shape == (6, 3, 3, 2, 3)
    tiles_of(Blob(x.shape), x, T, blob.pitch, blob.data)
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
    x = np.random.default_rng(0).normal(size=shape).astype(np.float32)
    first, second = tiled(shape, one, spare), tiled(shape, other)
    a = tiles_of(Blob(shape), x, one, first.pitch, first.data)
    b = tiles_of(first, a, other, second.pitch, second.data)
    assert np.array_equal(plain_of(first, a), x)
    assert np.array_equal(plain_of(second, b), x)


def test_tiles_of_the_same_kind_are_not_copied() -> None:
    """A layer that wants what is there gets it."""
    blob = tiled((2, 3, 4, 4), 2)
    out = np.empty(blob.storage_shape, np.float32)
    assert tiles_of(blob, blob.data, 2, blob.pitch, out) is blob.data
