"""Blob: data and diff of the same shape."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from netlib.blob import Blob, Blobs, BlobVec, blocks


def test_a_new_blob_is_zero() -> None:
    blob = Blob((2, 3), np.float64)
    assert blob.data.tolist() == blob.diff.tolist() == [[0, 0, 0], [0, 0, 0]]
    assert blob.data.dtype == np.float64
    assert (blob.count, Blob(()).count, Blob((3, 0)).count) == (6, 1, 0)


def test_an_array_has_its_own_shape_and_flags() -> None:
    """The shape and the flags of an accessed array are local to it, as in pycaffe; its values
    are the blob's.
    """
    blob, other = Blob((2, 3)), Blob((6,))
    other.share(blob)
    for one in (blob, other):
        for name in ("data", "diff"):
            array = getattr(one, name)
            array.shape = (3, 2)
            array[0, 1] = 7
            array.flags.writeable = False
            assert getattr(one, name).shape == one.shape
            assert getattr(one, name).reshape(-1)[1] == 7
            getattr(one, name)[...] = 0


def test_an_assigned_parameter_shares_its_memory() -> None:
    """A parameter that is assigned has the values and gradients of the other blob; the list
    keeps its own blob.
    """
    own, other = BlobVec([Blob((2, 3)), Blob((4,))]), Blob((3, 2))
    kept, other.data[...] = own[0], 5
    own[0] = other
    assert own[0] is kept
    assert kept.shape == (2, 3)
    assert (kept.data == 5).all()
    kept.diff[...] = 3
    assert (other.diff == 3).all()
    with pytest.raises(
        ValueError, match=r"<Blob 3x2 float32> cannot take the place of <Blob 4 float32>"
    ):
        own[1] = other
    with pytest.raises(ValueError, match="float64"):
        own[0] = Blob((2, 3), np.float64)


def test_reshape_takes_numbers_or_a_shape_and_forgets_values_only_with_another_count() -> None:
    blob = Blob((2, 3))
    blob.data[...] = 5
    blob.reshape(2, 3)
    assert (blob.data == 5).all()
    blob.reshape((3, 2))
    assert blob.shape == (3, 2)
    assert (blob.data == 5).all()
    blob.reshape(3, 3)
    assert not blob.data.any()
    for scalar in ([()], []):
        blob.reshape(2, 3)
        blob.reshape(*scalar)
        assert blob.data.shape == ()
    with pytest.raises(ValueError, match=r"cannot have the shape \(2, -1\)"):
        blob.reshape(2, -1)


@pytest.mark.parametrize(("keeps_first", "kept"), [(True, [0, 1, 2]), (False, [0, 0, 0])])
def test_a_smaller_input_keeps_its_first_values(keeps_first: bool, kept: list[int]) -> None:
    blob = Blob((2, 3))
    blob.keeps_first = keeps_first
    held = blob.data
    held[...] = np.arange(6).reshape(2, 3)
    blob.reshape(1, 3)
    assert blob.data.tolist() == [kept]
    assert np.shares_memory(blob.data, held) == keeps_first
    blob.reshape(2, 3)
    assert not blob.data.any()


@pytest.mark.parametrize("shape", [(2**62,), (0, 2**64), (10**10, 10**10), (1,) * 33])
def test_shapes_that_no_array_can_have(shape: tuple[int, ...]) -> None:
    with pytest.raises((ValueError, MemoryError), match="a blob cannot have the shape"):
        Blob(shape)
    with pytest.raises((ValueError, MemoryError), match="a blob cannot have the shape"):
        Blob().reshape(shape)


def test_caffes_names_of_the_axes() -> None:
    """Axes that the blob lacks have size 1."""
    blob = Blob((5, 4, 3))
    assert (blob.num, blob.channels, blob.height, blob.width) == (5, 4, 3, 1)
    assert repr(blob) == "<Blob 5x4x3 float32>"
    assert repr(Blob(())) == "<Blob scalar float32>"


def test_add_blob_makes_a_parameter() -> None:
    """The parameter has the type of the list; Caffe's Python layers create parameters this way."""
    blobs = Blobs(dtype=np.float64)
    assert blobs.add_blob(2, 3) is blobs[0]
    assert (blobs[0].shape, blobs[0].data.dtype) == ((2, 3), np.float64)


def test_a_shared_blob_uses_its_owners_memory() -> None:
    owner, one, two = Blob((2, 3)), Blob((6,)), Blob((3, 2))
    one.share(owner)
    two.share(one)
    owner.data[...] = np.arange(6).reshape(2, 3)
    two.diff[2, 1] = 7
    assert one.data.tolist() == [0, 1, 2, 3, 4, 5]
    assert two.data.tolist() == [[0, 1], [2, 3], [4, 5]]
    assert owner.diff[1, 2] == 7


def test_a_blob_that_shares_data_keeps_its_diff() -> None:
    """A blob that shares only data keeps its own diff, or the diff of a blob it shared before."""
    other, owner, one, two = Blob((3,)), Blob((3,)), Blob((3,)), Blob((3,))
    two.share(one)
    for blob in (one, two):
        blob.share_data(owner)
    owner.data[...], one.diff[...] = 5, 2
    assert one.data.tolist() == two.data.tolist() == [5, 5, 5]
    assert two.diff.tolist() == [2, 2, 2]
    assert not owner.diff.any()
    owner.share_data(other)
    assert not two.data.any()
    other.share_data(two)  # other is the same memory by now
    assert not other.data.any()


def test_the_version_changes_with_the_shape_and_with_the_memory_of_the_data() -> None:
    owner, blob = Blob((2, 3)), Blob((2, 3))
    changes = [
        lambda: blob.reshape(6),
        lambda: blob.reshape(2, 3),  # its values may be other ones now
        lambda: blob.share_data(owner),
    ]
    for change in changes:
        before = blob.version
        change()
        assert blob.version != before
    kept = [lambda: blob.reshape(2, 3), lambda: blob.share_data(owner), blob.unshare_data]
    before = blob.version
    for change in kept:
        change()
        assert blob.version == before


@given(st.integers(0, 300), st.integers(1, 40))
def test_blocks_cut_a_range(count: int, size: int) -> None:
    pieces = [list(range(count))[rows] for rows in blocks(count, size)]
    assert [i for piece in pieces for i in piece] == list(range(count))
    assert all(0 < len(piece) <= size for piece in pieces)
