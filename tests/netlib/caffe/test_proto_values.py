"""Values of the fields of caffe_pb2's messages: lists of scalars, of numbers and of messages."""

from __future__ import annotations

import numpy as np
import pytest

from netlib.caffe.proto import caffe_pb2


def layer() -> caffe_pb2.Message:
    made = caffe_pb2.LayerParameter(bottom=["x"])
    made.convolution_param.kernel_size.extend([3, 5])
    return made


def test_what_repeated_fields_take() -> None:
    """Each element of a repeated field is checked."""
    made = layer()
    for wrong, error in (("3", TypeError), (-1, ValueError), (1.5, TypeError), (2**32, ValueError)):
        with pytest.raises(error, match="kernel_size"):
            made.convolution_param.kernel_size.append(wrong)
    made.convolution_param.kernel_size[0] = np.int64(7)
    made.convolution_param.kernel_size.insert(1, 6)
    assert made.convolution_param.kernel_size == [7, 6, 5]
    made.bottom[:] = ["a", "b"]
    made.bottom.remove("a")
    assert list(made.bottom) == ["b"]


def test_blobs_hold_arrays() -> None:
    """Arrays of blob values are stored and returned as a whole."""
    blob = caffe_pb2.BlobProto()
    values = np.random.default_rng(0).normal(size=1000).astype(np.float32)
    blob.data.extend(values)
    blob.data.append(0.5)
    blob.shape.dim.extend([7, 143])
    again = caffe_pb2.BlobProto.FromString(blob.SerializeToString())
    assert np.array_equal(np.array(again.data)[:-1], values)
    assert (len(again.data), again.data[-1], again.data[-1:]) == (1001, 0.5, [0.5])
    assert list(again.shape.dim) == [7, 143]
    again.data[0] = 2
    del again.data[1:]
    assert again.data == [2]


def test_blobs_in_double_precision_have_bytes() -> None:
    """double_data and double_diff survive a round trip through bytes."""
    blob = caffe_pb2.BlobProto(double_data=[0.1, -2], double_diff=[3])
    again = caffe_pb2.BlobProto.FromString(blob.SerializeToString())
    assert (list(again.double_data), list(again.double_diff), again == blob) == ([0.1, -2], [3], True)
    assert "double_data: 0.1\n" in str(blob)


def test_lists_say_what_they_hold() -> None:
    """Lists print as Python lists and compare equal to them."""
    made, blob = layer(), caffe_pb2.BlobProto(data=[1, 2.5])
    assert (repr(made.bottom), repr(made.convolution_param.kernel_size), repr(blob.data)) == (
        "['x']",
        "[3, 5]",
        "[1.0, 2.5]",
    )
    assert blob.data == [1, 2.5] != [1, 2]
    blob.data.extend(blob.data)
    blob.data.insert(0, 7)
    blob.data[1:3] = [0, 0]
    assert blob.data == [7, 0, 0, 1, 2.5]


def test_numbers_as_their_field_holds_them() -> None:
    """A float field has 32 bits and overflows to infinity; a double field has 64."""
    filler = caffe_pb2.FillerParameter(value=0.1, std=1e39)
    assert (filler.value, filler.std) == (float(np.float32(0.1)), float("inf"))
    assert list(caffe_pb2.BlobProto(double_data=[0.1]).double_data) == [0.1]


def test_lists_of_messages() -> None:
    """Messages in a list can be added, inserted, sorted and deleted, but not replaced."""
    net = caffe_pb2.NetParameter()
    net.layer.add(name="b")
    net.layer.insert(0, caffe_pb2.LayerParameter(name="c"))
    net.layer.sort(key=lambda layer: layer.name)
    assert [each.name for each in net.layer] == ["b", "c"]
    with pytest.raises(TypeError, match=r"'layer' is a repeated message: use add\(\), append\(\) or CopyFrom\(\)"):
        net.layer[0] = caffe_pb2.LayerParameter()
    del net.layer[0]
    assert [each.name for each in net.layer] == ["c"]
