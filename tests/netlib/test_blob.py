"""Blob: data and diff of one shape."""

from __future__ import annotations

import numpy as np
import pytest

from netlib.blob import Blob, Blobs


def test_a_new_blob_is_zero() -> None:
    """Data and diff, of the given type."""
    blob = Blob((2, 3), np.float64)
    assert blob.data.tolist() == blob.diff.tolist() == [[0, 0, 0], [0, 0, 0]]
    assert blob.data.dtype == np.float64
    assert (blob.count, Blob(()).count, Blob((3, 0)).count) == (6, 1, 0)


def test_reshape_takes_numbers_or_a_shape_and_forgets_values_only_with_another_count() -> None:
    """As Caffe's Python interface does."""
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


@pytest.mark.parametrize("shape", [(2**62,), (0, 2**64), (10**10, 10**10), (1,) * 33])
def test_shapes_that_no_array_can_have(shape: tuple[int, ...]) -> None:
    """Found when they are asked for, not by the first who looks at the values."""
    with pytest.raises((ValueError, MemoryError), match="a blob cannot have the shape"):
        Blob(shape)
    with pytest.raises((ValueError, MemoryError), match="a blob cannot have the shape"):
        Blob().reshape(shape)


def test_caffes_names_of_the_axes() -> None:
    """Missing axes have size 1."""
    blob = Blob((5, 4, 3))
    assert (blob.num, blob.channels, blob.height, blob.width) == (5, 4, 3, 1)
    assert repr(blob) == "<Blob 5x4x3 float32>"
    assert repr(Blob(())) == "<Blob scalar float32>"


def test_add_blob_makes_a_parameter() -> None:
    """Of the list's type: how a Caffe Python layer makes its parameters."""
    blobs = Blobs(dtype=np.float64)
    assert blobs.add_blob(2, 3) is blobs[0]
    assert (blobs[0].shape, blobs[0].data.dtype) == ((2, 3), np.float64)


def test_a_shared_blob_uses_its_owners_memory() -> None:
    """Data and diff, in its own shape, also through a second share."""
    owner, one, two = Blob((2, 3)), Blob((6,)), Blob((3, 2))
    one.share(owner)
    two.share(one)
    owner.data[...] = np.arange(6).reshape(2, 3)
    two.diff[2, 1] = 7
    assert one.data.tolist() == [0, 1, 2, 3, 4, 5]
    assert two.data.tolist() == [[0, 1], [2, 3], [4, 5]]
    assert owner.diff[1, 2] == 7


def test_a_blob_that_shares_data_keeps_its_diff() -> None:
    """Its own, or that of another blob which it shared before."""
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
    other.share_data(two)  # which is itself by now
    assert not other.data.any()
