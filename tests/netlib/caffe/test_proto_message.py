"""caffe_pb2's messages behave like protobuf's: every assertion also holds for a class that protobuf compiled."""

from __future__ import annotations

import copy
import io
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
    """Text and bytes list fields in the order of their numbers, and both parse back to the message."""
    made = layer()
    assert str(made) == TEXT
    assert caffe_pb2.LayerParameter.FromString(made.SerializeToString()) == made
    assert text_format.Merge(TEXT, caffe_pb2.LayerParameter()) == made
    text_format.PrintMessage(made, out := io.StringIO())
    assert out.getvalue() == text_format.MessageToString(made) == TEXT
    assert made.ByteSize() == len(made.SerializeToString())
    assert pickle.loads(pickle.dumps(made)) == copy.deepcopy(made) == made


def test_what_is_not_set_reads_as_its_default() -> None:
    """Reading an unset field returns its default and sets nothing; setting a nested field sets its parent."""
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


def test_what_is_forgotten_reads_as_its_default_again() -> None:
    """Deleting, clearing or parsing over a message restores the defaults of the fields that are no longer set."""
    made = layer()
    del made.name
    made.ClearField("pooling_param")
    assert (made.name, made.HasField("pooling_param"), made.bottom) == ("", False, ["x"])
    made.Clear()
    assert made == caffe_pb2.LayerParameter()
    made.name = "before"
    size = made.ParseFromString(layer().SerializeToString())
    assert (made, size) == (layer(), layer().ByteSize())


def test_what_caffe_has_nothing_of() -> None:
    """Methods for required fields, unknown fields and oneofs exist, because protobuf's text_format calls them."""
    made = layer()
    assert made.IsInitialized()
    assert made.FindInitializationErrors() == made.UnknownFields() == []
    with pytest.raises(ValueError, match="LayerParameter has no oneof 'x'"):
        made.WhichOneof("x")


def test_fields_say_what_they_are() -> None:
    """Field descriptors have protobuf's numbers, types, labels and defaults."""
    fields = caffe_pb2.ConvolutionParameter.DESCRIPTOR.fields_by_name
    pad, bias, engine, filler = (fields[name] for name in ("pad", "bias_term", "engine", "weight_filler"))
    assert (pad.number, pad.type, pad.label, pad.default_value) == (3, 13, pad.LABEL_REPEATED, [])
    assert (bias.type, bias.label, bias.has_default_value, bias.default_value) == (8, bias.LABEL_OPTIONAL, True, True)
    assert (engine.type, engine.default_value, engine.enum_type.Name(2)) == (14, 0, "CUDNN")
    assert (filler.type, filler.has_default_value, filler.message_type.name) == (11, False, "FillerParameter")
    norm = caffe_pb2.HingeLossParameter.DESCRIPTOR.fields_by_name["norm"]
    assert (norm.default_value, norm.enum_type.values()) == (1, [1, 2])


def test_copies_are_copies() -> None:
    """Messages that are added to a list are copied."""
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
    """Enum values are available as constants of the message and through the enum itself."""
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
    """An invalid assignment raises protobuf's type of error with the name of the field."""
    with pytest.raises(error, match=name):
        setattr(layer(), name, value)


def test_a_datum_holds_bytes() -> None:
    """Datum.data holds arbitrary bytes, not text."""
    datum = caffe_pb2.Datum(channels=1, data=b"\x00\xff", label=-3)
    again = caffe_pb2.Datum.FromString(datum.SerializeToString())
    assert (again.data, again.label) == (b"\x00\xff", -3)


def test_old_nets_are_nets() -> None:
    """Old nets are kept in the format of the file; they are not upgraded."""
    net = text_format.Merge('layers { type: RELU layer { name: "r" } blobs_lr: 2 }', caffe_pb2.NetParameter())
    assert net.layers[0].type == caffe_pb2.V1LayerParameter.RELU == 18
    assert (net.layers[0].layer.name, net.layers[0].blobs_lr) == ("r", [2])
    solver = caffe_pb2.SolverParameter()
    solver.net_param.CopyFrom(net)
    assert caffe_pb2.SolverParameter.FromString(solver.SerializeToString()) == solver


def test_mistakes_in_text_and_bytes() -> None:
    """Errors in text and bytes are reported on one line with their position."""
    with pytest.raises(PrototxtError, match=r"1:1: error: unknown field 'nmae' \(did you mean 'name'\?\)"):
        text_format.Parse("nmae: 1", caffe_pb2.NetParameter())
    with pytest.raises(WireError, match="not a NetParameter: <bytes>: byte 0: malformed"):
        caffe_pb2.NetParameter().ParseFromString(b"\x07")
    with pytest.raises(TypeError, match="expected bytes, found str; open binary files with 'rb'"):
        caffe_pb2.NetParameter().ParseFromString("x")
    with pytest.raises(TypeError, match="expected a LayerParameter, found NetParameter"):
        layer().CopyFrom(caffe_pb2.NetParameter())


def test_protobufs_own_text_format_takes_them() -> None:
    """protobuf's own text_format accepts these messages."""
    google = pytest.importorskip("google.protobuf.text_format")
    assert google.Merge(TEXT, caffe_pb2.LayerParameter()) == layer()
    assert google.MessageToString(layer()) == TEXT
    with pytest.raises(google.ParseError, match="no field named"):
        google.Merge("nmae: 1", caffe_pb2.NetParameter())
