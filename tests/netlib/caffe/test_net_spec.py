"""caffe.net_spec: nets written in Python."""

from __future__ import annotations

import copy

import numpy as np
import pytest
from google.protobuf import text_format

import netlib.caffe as caffe
from netlib.caffe import layers as L
from netlib.caffe import params as P
from netlib.caffe.net_spec import Function, SpecError, Top, assign_proto, param_name_dict
from netlib.caffe.proto import caffe_pb2
from netlib.errors import NetlibError


def small_net() -> caffe.NetSpec:
    n = caffe.NetSpec()
    n.data, n.label = L.DummyData(shape=[{"dim": [2, 1, 8, 8]}, {"dim": 2}], ntop=2)
    n.conv = L.Convolution(
        n.data, kernel_size=3, num_output=4, weight_filler={"type": "xavier"}, param=[{"lr_mult": 1}, {"lr_mult": 2}]
    )
    n.pool = L.Pooling(n.conv, kernel_size=2, stride=2, pool=P.Pooling.AVE)
    n.relu = L.ReLU(n.pool, in_place=True)
    n.ip = L.InnerProduct(n.relu, num_output=3)
    n.loss = L.SoftmaxWithLoss(n.ip, n.label, loss_weight=2)
    return n


def test_the_net_as_text():
    """Options are written to the block of the layer type or to the layer; names are those of the attributes."""
    text = str(small_net().to_proto())
    expected = """
    layer { name: "data" type: "DummyData" top: "data" top: "label"
            dummy_data_param { shape { dim: 2 dim: 1 dim: 8 dim: 8 } shape { dim: 2 } } }
    layer { name: "conv" type: "Convolution" bottom: "data" top: "conv" param { lr_mult: 1.0 } param { lr_mult: 2.0 }
            convolution_param { num_output: 4 kernel_size: 3 weight_filler { type: "xavier" } } }
    layer { name: "pool" type: "Pooling" bottom: "conv" top: "pool"
            pooling_param { pool: AVE kernel_size: 2 stride: 2 } }
    layer { name: "relu" type: "ReLU" bottom: "pool" top: "pool" }
    layer { name: "ip" type: "InnerProduct" bottom: "pool" top: "ip" inner_product_param { num_output: 3 } }
    layer { name: "loss" type: "SoftmaxWithLoss" bottom: "ip" bottom: "label" top: "loss" loss_weight: 2.0 }
    """
    assert text == str(text_format.Parse(expected, caffe_pb2.NetParameter()))


def test_the_net_runs(tmp_path):
    """The text, written to a file, loads as a net and runs."""
    path = tmp_path / "net.prototxt"
    path.write_text(str(small_net().to_proto()))
    net = caffe.Net(str(path), caffe.TEST)
    assert [layer.type for layer in net.layers] == [
        "DummyData", "Convolution", "Pooling", "ReLU", "InnerProduct", "SoftmaxWithLoss",
    ]  # fmt: skip
    assert net.forward()["loss"] > 0 and net.blobs["pool"].shape == (2, 4, 3, 3)


def test_names_are_made_for_what_has_none():
    """Unnamed layers are numbered by type from 1 and take the name of their first top; shared inputs occur once."""
    data, label = L.DummyData(shape={"dim": [1, 2]}, ntop=2)
    left, right = L.Slice(L.InnerProduct(data, num_output=4), slice_point=2, ntop=2)
    net = caffe.to_proto(L.Eltwise(L.TanH(left), right), L.EuclideanLoss(L.TanH(right), label))
    assert [(layer.name, list(layer.top)) for layer in net.layer] == [
        ("DummyData1", ["DummyData1", "DummyData2"]),
        ("InnerProduct1", ["InnerProduct1"]),
        ("Slice1", ["Slice1", "Slice2"]),
        ("TanH1", ["TanH1"]),
        ("Eltwise1", ["Eltwise1"]),
        ("TanH2", ["TanH2"]),
        ("EuclideanLoss1", ["EuclideanLoss1"]),
    ]
    assert [list(layer.bottom) for layer in net.layer[3:]] == [
        ["Slice1"], ["TanH1", "Slice2"], ["Slice2"], ["TanH2", "DummyData2"],
    ]  # fmt: skip


def test_a_top_gives_its_net():
    """``top.to_proto()`` contains only the layers that the top needs."""
    n = small_net()
    assert isinstance(n.pool, Top)
    assert [layer.type for layer in n.pool.to_proto().layer] == ["DummyData", "Convolution", "Pooling"]


def test_layers_without_tops():
    """With ntop 0 the call returns the layer itself, which a NetSpec accepts."""
    n = caffe.NetSpec()
    n.data = L.DummyData(shape={"dim": 3})
    n.quiet = L.Silence(n.data, ntop=0)
    assert isinstance(n.quiet, Function)
    assert [(layer.name, list(layer.top)) for layer in n.to_proto().layer] == [("data", ["data"]), ("quiet", [])]
    assert caffe.to_proto(L.Silence(n.data, ntop=0)).layer[1].name == "Silence1"


def test_deep_nets():
    """A net may be deeper than Python's recursion limit."""
    top = L.Input(shape={"dim": 1})
    for _ in range(3000):
        top = L.ReLU(top)
    assert top.to_proto().layer[-1].name == "ReLU3000"


def test_options_of_the_layer_and_of_its_block():
    """A block may be given as a dict; include, name and similar options belong to the layer."""
    n = caffe.NetSpec()
    n.data = L.Input(input_param={"shape": [{"dim": [1, 2]}]}, include={"phase": caffe.TEST}, name="in")
    n.my = L.Python(n.data, module="mine", layer="My", param_str="x")
    data, my = n.to_proto().layer
    assert data.name == "in" and data.include[0].phase == caffe.TEST and list(data.input_param.shape[0].dim) == [1, 2]
    assert (my.python_param.module, my.python_param.layer, my.python_param.param_str) == ("mine", "My", "x")


def test_a_netspec_has_items_too():
    """Item access allows names that are not Python identifiers."""
    n = caffe.NetSpec()
    n["conv1/relu"] = L.Input(shape={"dim": 1})
    assert n["conv1/relu"] is n.tops["conv1/relu"] and list(n.tops) == ["conv1/relu"]
    assert n.to_proto().layer[0].name == "conv1/relu"
    assert not hasattr(n, "conv") and list(copy.copy(n).tops) == ["conv1/relu"]


def test_constants():
    """The constants are those of caffe_pb2."""
    assert (P.Pooling.MAX, P.Pooling.AVE) == (caffe_pb2.PoolingParameter.MAX, caffe_pb2.PoolingParameter.AVE)
    assert P.Eltwise.MAX == caffe_pb2.EltwiseParameter.MAX


def test_blocks_by_type():
    """param_name_dict maps a layer type to the name of its options block."""
    names = param_name_dict()
    assert names["InnerProduct"] == "inner_product" and names["HDF5Data"] == "hdf5_data" and names["LRN"] == "lrn"


def test_assign_proto():
    """Lists fill repeated fields, dicts fill messages; a single value is a list of one."""
    layer = caffe_pb2.LayerParameter()
    assign_proto(layer, "param", [{"lr_mult": 0}, {"name": "w"}])
    assign_proto(layer, "convolution_param", {"kernel_size": (3, 5), "weight_filler": {"type": "constant", "value": 2}})
    assign_proto(layer, "loss_weight", np.float32(0.5))
    assign_proto(layer, "include", [])
    assert [(p.lr_mult, p.name) for p in layer.param] == [(0, ""), (1, "w")]
    assert list(layer.convolution_param.kernel_size) == [3, 5] and layer.convolution_param.weight_filler.value == 2
    assert list(layer.loss_weight) == [0.5] and len(layer.include) == 0
    assign_proto(layer, "power_param", caffe_pb2.PowerParameter(power=3))
    assert layer.power_param.power == 3


# ---------------------------------------------------------------------------------------------- mistakes


def mistake(top: Top) -> str:
    with pytest.raises(SpecError) as found:
        top.to_proto()
    assert isinstance(found.value, NetlibError) and "\n" not in str(found.value)
    return str(found.value)


def test_unknown_options():
    """The error names the layer and the option, and suggests the nearest option or its block."""
    data = L.Input(shape={"dim": 1})
    assert mistake(L.Convolution(data, kernal_size=3)) == (
        "layer 'Convolution1' (Convolution): unknown option 'kernal_size' (did you mean 'kernel_size'?)"
    )
    assert mistake(L.ReLU(data, zzz=1)).endswith("unknown option 'zzz'; its options: negative_slope, engine")
    assert mistake(L.Deconvolution(data, num_output=1)).endswith(
        "(Deconvolution): option 'num_output' is in another block; write convolution_param=dict(num_output=...)"
    )
    assert mistake(L.SoftmaxWithLoss(data, ignore_label=1)).endswith("write loss_param=dict(ignore_label=...)")
    assert mistake(L.SoftmaxWithLoss(data, zzz=1)).endswith(
        "; its options: softmax_param=dict(...), loss_param=dict(...)"
    )
    assert mistake(L.Silence(data, zzz=1)).endswith("unknown option 'zzz'; it has none")
    assert mistake(L.Convolution(data, weight_filler={"tipe": "xavier"})).endswith(
        "FillerParameter has no field 'tipe' (did you mean 'type'?)"
    )
    assert mistake(L.Convolution(data, convolutoin_param={})).endswith("(did you mean 'convolution_param'?)")


def test_an_unknown_option_is_an_attribute_error():
    """An unknown option is an AttributeError, as in pycaffe."""
    with pytest.raises(AttributeError):
        L.ReLU(L.Input(shape={"dim": 1}), zzz=1).to_proto()


def test_values_that_an_option_cannot_have():
    """The error names the option, the message and the invalid value."""
    data = L.Input(shape={"dim": 1})
    assert "'num_output' of ConvolutionParameter cannot be 'many'" in mistake(L.Convolution(data, num_output="many"))
    assert "'num_output' of ConvolutionParameter cannot be [1, 2]" in mistake(L.Convolution(data, num_output=[1, 2]))
    assert "'weight_filler' of ConvolutionParameter cannot be 'xavier'" in mistake(
        L.Convolution(data, weight_filler="xavier")
    )
    assert "'pool' of PoolingParameter cannot be 9" in mistake(L.Pooling(data, pool=9))
    with pytest.raises(TypeError):
        L.Convolution(data, num_output={}).to_proto()


def test_inputs_that_are_no_tops():
    """An input that is not a Top raises pycaffe's TypeError with the layer and the number of the input."""
    pair = L.DummyData(ntop=2)
    with pytest.raises(TypeError, match=r"^Silence input 0 is not a Top \(type is <class 'tuple'>\)$"):
        L.Silence(pair, ntop=0)


def test_names_for_what_is_no_top():
    """A single name for the two tops of a data layer is reported with the correct assignment."""
    n = caffe.NetSpec()
    n.data = L.DummyData(ntop=2)
    with pytest.raises(NetlibError, match=r"'data' of the net is not a Top .* n\.data, n\.label = "):
        n.to_proto()


def test_names_that_are_not_there():
    """Unknown names raise an AttributeError with a suggestion."""
    n = small_net()
    with pytest.raises(AttributeError, match=r"no top 'conv1' \(did you mean 'conv'\?\)"):
        _ = n.conv1
    with pytest.raises(KeyError):
        _ = n["conv1"]
    with pytest.raises(AttributeError, match=r"params has no 'Poling' \(did you mean 'Pooling'\?\)"):
        _ = P.Poling.MAX
    with pytest.raises(AttributeError, match=r"params\.Pooling has no 'MEAN'; it has MAX, AVE, STOCHASTIC"):
        _ = P.Pooling.MEAN
    assert not hasattr(P, "__path__") and not hasattr(L, "__path__") and not hasattr(P.Pooling, "__len__")
