"""caffe_pb2's messages behave like protobuf's: each statement here is true of a class that protobuf compiled."""

from __future__ import annotations

import copy
import pickle

import numpy as np
import pytest

from netlib.caffe.proto import caffe_pb2, text_format
from netlib.errors import PrototxtError, WireError


def layer() -> caffe_pb2.Message:
    made = caffe_pb2.LayerParameter(name="c", bottom=["x"])
    made.convolution_param.kernel_size.extend([3, 5])
    made.convolution_param.weight_filler.type = "xavier"
    made.pooling_param.pool = caffe_pb2.PoolingParameter.AVE
    return made


TEXT = """\
name: "c"
bottom: "x"
convolution_param {
  kernel_size: 3
  kernel_size: 5
  weight_filler {
    type: "xavier"
  }
}
pooling_param {
  pool: AVE
}
"""


def test_text_and_bytes() -> None:
    """Fields in the order of their numbers; back from both."""
    made = layer()
    assert str(made) == TEXT
    assert caffe_pb2.LayerParameter.FromString(made.SerializeToString()) == made
    assert text_format.Merge(TEXT, caffe_pb2.LayerParameter()) == made
    assert made.ByteSize() == len(made.SerializeToString())
    assert pickle.loads(pickle.dumps(made)) == copy.deepcopy(made) == made


def test_what_is_not_set_reads_as_its_default() -> None:
    """And looking sets nothing; setting something inside sets what holds it."""
    made = caffe_pb2.LayerParameter()
    assert made.convolution_param.group == 1
    assert made.lrn_param.beta == 0.75
    assert made.reduction_param.operation == caffe_pb2.ReductionParameter.SUM == 1
    assert (made.name, made.phase, len(made.bottom)) == ("", caffe_pb2.TRAIN, 0)
    assert not made.HasField("convolution_param")
    assert made.ListFields() == []
    made.convolution_param.weight_filler.std = 0.1
    assert made.HasField("convolution_param")
    assert made.convolution_param.weight_filler.std == np.float32(0.1)
    made.ClearField("convolution_param")
    assert str(made) == ""
    made.relu_param.SetInParent()
    assert str(made) == "relu_param {\n}\n"


def test_copies_are_copies() -> None:
    """Nothing that is put in is shared."""
    net, one = caffe_pb2.NetParameter(), layer()
    net.layer.extend([one])
    net.layer.add().CopyFrom(one)
    one.name = "changed"
    assert [each.name for each in net.layer] == ["c", "c"]
    net.MergeFrom(net.FromString(net.SerializeToString()))
    assert len(net.layer) == 4
    del net.layer[1:]
    assert len(net.layer) == 1


def test_enums_have_names_and_numbers() -> None:
    """As constants of the message, and of the enum itself."""
    pool = caffe_pb2.PoolingParameter.PoolMethod
    assert (caffe_pb2.PoolingParameter.STOCHASTIC, pool.Value("AVE"), pool.Name(0)) == (2, 1, "MAX")
    assert pool.DESCRIPTOR.values_by_name["AVE"].number == 1
    assert pool.items() == [("MAX", 0), ("AVE", 1), ("STOCHASTIC", 2)]
    assert (caffe_pb2.TRAIN, caffe_pb2.TEST) == (0, 1)
    assert caffe_pb2.SolverParameter.SolverMode.Value("GPU") == 1
    assert caffe_pb2.V1LayerParameter.LayerType.Value("DECONVOLUTION") == 39


@pytest.mark.parametrize(
    ("name", "value", "error"),
    [
        ("name", 3, TypeError),
        ("nam", "c", AttributeError),
        ("convolution_param", {}, AttributeError),
        ("bottom", ["x"], AttributeError),
        ("phase", 7, ValueError),
    ],
)
def test_what_cannot_be_assigned(name: str, value: object, error: type[Exception]) -> None:
    """One line with the field."""
    with pytest.raises(error, match=name):
        setattr(layer(), name, value)


def test_what_repeated_fields_take() -> None:
    """Elements are checked one by one."""
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
    """A blob may have millions of numbers: they go in and out in one piece."""
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
    """Those of a net in float64."""
    blob = caffe_pb2.BlobProto(double_data=[0.1, -2], double_diff=[3])
    again = caffe_pb2.BlobProto.FromString(blob.SerializeToString())
    assert (list(again.double_data), list(again.double_diff), again == blob) == ([0.1, -2], [3], True)
    assert "double_data: 0.1\n" in str(blob)


def test_a_datum_holds_bytes() -> None:
    """Not text."""
    datum = caffe_pb2.Datum(channels=1, data=b"\x00\xff", label=-3)
    again = caffe_pb2.Datum.FromString(datum.SerializeToString())
    assert (again.data, again.label) == (b"\x00\xff", -3)


def test_old_nets_are_nets() -> None:
    """As the file has them: whoever wants today's upgrades them."""
    net = text_format.Merge('layers { type: RELU layer { name: "r" } blobs_lr: 2 }', caffe_pb2.NetParameter())
    assert net.layers[0].type == caffe_pb2.V1LayerParameter.RELU == 18
    assert (net.layers[0].layer.name, net.layers[0].blobs_lr) == ("r", [2])
    solver = caffe_pb2.SolverParameter()
    solver.net_param.CopyFrom(net)
    assert caffe_pb2.SolverParameter.FromString(solver.SerializeToString()) == solver


def test_mistakes_in_text_and_bytes() -> None:
    """One line, with the place."""
    with pytest.raises(PrototxtError, match=r"1:1: error: unknown field 'nmae' \(did you mean 'name'\?\)"):
        text_format.Parse("nmae: 1", caffe_pb2.NetParameter())
    with pytest.raises(WireError, match="not a NetParameter: <bytes>: byte 0: malformed"):
        caffe_pb2.NetParameter().ParseFromString(b"\x07")
    with pytest.raises(TypeError, match="expected bytes, found str; open binary files with 'rb'"):
        caffe_pb2.NetParameter().ParseFromString("x")
    with pytest.raises(TypeError, match="expected a LayerParameter, found NetParameter"):
        layer().CopyFrom(caffe_pb2.NetParameter())


def test_protobufs_own_text_format_takes_them() -> None:
    """Scripts use it where protobuf is installed."""
    google = pytest.importorskip("google.protobuf.text_format")
    assert google.Merge(TEXT, caffe_pb2.LayerParameter()) == layer()
    assert google.MessageToString(layer()) == TEXT
    with pytest.raises(google.ParseError, match="no field named"):
        google.Merge("nmae: 1", caffe_pb2.NetParameter())
