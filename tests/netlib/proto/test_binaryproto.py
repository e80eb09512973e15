"""Blobs in binary files: mean images and the blobs of weights."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from google.protobuf import text_format

from netlib.caffe import io
from netlib.caffe.proto import caffe_pb2
from netlib.errors import DataError, WireError
from netlib.proto import binaryproto, prototxt, schema, wire
from netlib.proto.messages import BlobProto
from tests.support.bad_input import bad_inputs


def proto(text: str) -> BlobProto:
    return schema.read(prototxt.parse(text), BlobProto)


def test_an_array_comes_back(here: Path) -> None:
    for array in (
        np.arange(6, dtype=np.float32).reshape(1, 2, 3),
        np.array(0.1),
        np.float32([[7]]),
    ):
        binaryproto.write_blob(array, "mean.binaryproto")
        found = binaryproto.read_blob("mean.binaryproto")
        assert (found.dtype, found.shape) == (array.dtype, array.shape)
        assert np.array_equal(found, array)


def test_a_mean_image_is_written_as_caffe_writes_it(here: Path) -> None:
    """Scripts read its fields channels, height and width, not its shape."""
    binaryproto.write_blob(np.zeros((1, 3, 2, 4), np.float32), "mean.binaryproto")
    blob = caffe_pb2.BlobProto.FromString(Path("mean.binaryproto").read_bytes())
    assert (blob.num, blob.channels, blob.height, blob.width, blob.HasField("shape")) == (
        1,
        3,
        2,
        4,
        False,
    )


@pytest.mark.parametrize("shape", ["", "shape { dim: 24 }"])
def test_four_axes_take_precedence_over_a_shape(shape: str) -> None:
    """As in Caffe and in pycaffe's io; blobs of before 2015 have no shape."""
    text = f"num: 1 channels: 2 height: 3 width: 4 {shape} data: {list(range(24))}"
    blob = text_format.Parse(text, caffe_pb2.BlobProto())
    assert (
        binaryproto.array_of(proto(text)).shape == io.blobproto_to_array(blob).shape == (1, 2, 3, 4)
    )


@pytest.mark.parametrize(
    ("kind", "written", "read"),
    [("FLOAT16", "<f2", np.float32), ("FLOAT", "<f4", np.float32), ("DOUBLE", "<f8", float)],
)
def test_raw_values(here: Path, kind: str, written: str, read: type) -> None:
    """Values in raw_data, as in half-precision files of OpenCV and NVIDIA's Caffe, are read; half
    becomes single.
    """
    blob = caffe_pb2.BlobProto(
        raw_data_type=kind, raw_data=np.array([1.5, -0.1, 3], written).tobytes()
    )
    blob.shape.dim.extend([3, 1])
    Path("raw.binaryproto").write_bytes(blob.SerializeToString())
    found = binaryproto.read_blob("raw.binaryproto")
    assert found.dtype == read
    assert np.array_equal(found, np.array([[1.5], [-0.1], [3]], written).astype(read))
    blob.raw_data += b"1"
    with pytest.raises(WireError, match=r"bytes of raw_data are no float\d\d array"):
        binaryproto.array_of(
            schema.read(wire.decode(blob.SerializeToString(), BlobProto), BlobProto)
        )


@bad_inputs(
    WireError,
    {
        "shape { dim: 3 } data: [1, 2]": "<text>:1:1: a blob of shape (3,) has 2 values",
        "shape { dim: -1 dim: -2 } data: [1, 2]": "<text>:1:1: a blob of shape (-1, -2) has 2 values",
        "shape { dim: 4611686018427387904 }": "<text>:1:1: a blob of shape (4611686018427387904,) has 0 values",
        "data: [1, 2]": "<text>:1:1: a blob of shape (0, 0, 0, 0) has 2 values",
    },
)
def test_a_shape_that_does_not_fit_its_values(given: str, rejected: Any) -> None:
    """A shape that does not match the values raises an error, and no memory is allocated for it."""
    with rejected:
        binaryproto.array_of(proto(given))


@bad_inputs(
    DataError,
    {
        "missing": (None, "...mean.binaryproto: cannot read the blob: No such file or directory"),
        "empty": (b"", "...mean.binaryproto: it holds no values; expected a blob (.binaryproto)"),
        "cut": (
            b"\x2a\x04",
            "...mean.binaryproto: byte 0: truncated: field 5 has 4 bytes, but 0 are left; expected ...",
        ),
        "one value": (
            b"\x2a\x04" + bytes(4),
            "...mean.binaryproto: byte 0: a blob of shape (0, 0, 0, 0) has 1 values; expected a blob ...",
        ),
    },
)
def test_invalid_files_are_rejected(here: Path, given: bytes | None, rejected: Any) -> None:
    if given is not None:
        Path("mean.binaryproto").write_bytes(given)
    with rejected:
        binaryproto.read_blob("mean.binaryproto")


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write anywhere")
def test_a_place_that_cannot_be_written(here: Path) -> None:
    here.chmod(0o500)
    with pytest.raises(DataError, match="cannot write the blob"):
        binaryproto.write_blob(np.zeros(1), "mean.binaryproto")
