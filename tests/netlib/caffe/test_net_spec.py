"""caffe.net_spec: nets written in Python."""

import copy
from collections import OrderedDict

import numpy as np
from google.protobuf import text_format

import netlib.caffe as caffe
from netlib.caffe import layers as L
from netlib.caffe import params as P
from netlib.caffe.net_spec import Function, Top, assign_proto, param_name_dict
from netlib.caffe.proto import caffe_pb2


def small_net() -> caffe.NetSpec:
    n = caffe.NetSpec()
    n.data, n.label = L.DummyData(shape=[{"dim": [2, 1, 8, 8]}, {"dim": 2}], ntop=2)
    n.conv = L.Convolution(
        n.data,
        kernel_size=3,
        num_output=4,
        weight_filler={"type": "xavier"},
        param=[{"lr_mult": 1}, {"lr_mult": 2}],
    )
    n.pool = L.Pooling(n.conv, kernel_size=2, stride=2, pool=P.Pooling.AVE)
    n.relu = L.ReLU(n.pool, in_place=True)
    n.ip = L.InnerProduct(n.relu, num_output=3)
    n.loss = L.SoftmaxWithLoss(n.ip, n.label, loss_weight=2)
    return n


def test_the_net_as_text():
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


def test_classes_are_pycaffes_by_identity():
    """Scripts compare them by ``type(x) is caffe.net_spec.Top``; several tops are a tuple."""
    n = small_net()
    assert (type(n), type(n.tops), type(n.conv)) == (caffe.NetSpec, OrderedDict, caffe.net_spec.Top)
    assert (type(n.conv.fn), type(n.conv.fn.tops)) == (caffe.net_spec.Function, tuple)
    assert (type(L), type(P)) == (caffe.net_spec.Layers, caffe.net_spec.Parameters)
    assert type(n.to_proto()) is caffe_pb2.NetParameter


def test_the_net_runs(tmp_path):
    path = tmp_path / "net.prototxt"
    path.write_text(str(small_net().to_proto()))
    net = caffe.Net(str(path), caffe.TEST)
    assert [layer.type for layer in net.layers] == [
        "DummyData",
        "Convolution",
        "Pooling",
        "ReLU",
        "InnerProduct",
        "SoftmaxWithLoss",
    ]
    assert net.forward()["loss"] > 0
    assert net.blobs["pool"].shape == (2, 4, 3, 3)


def test_names_are_made_for_what_has_none():
    """Unnamed layers are numbered by type from 1 and take the name of their first top; shared
    inputs occur once.
    """
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
        ["Slice1"],
        ["TanH1", "Slice2"],
        ["Slice2"],
        ["TanH2", "DummyData2"],
    ]


def test_a_top_gives_its_net():
    n = small_net()
    assert isinstance(n.pool, Top)
    assert [layer.type for layer in n.pool.to_proto().layer] == [
        "DummyData",
        "Convolution",
        "Pooling",
    ]


def test_layers_without_tops():
    n = caffe.NetSpec()
    n.data = L.DummyData(shape={"dim": 3})
    n.quiet = L.Silence(n.data, ntop=0)
    assert isinstance(n.quiet, Function)
    assert [(layer.name, list(layer.top)) for layer in n.to_proto().layer] == [
        ("data", ["data"]),
        ("quiet", []),
    ]
    assert caffe.to_proto(L.Silence(n.data, ntop=0)).layer[1].name == "Silence1"


def test_deep_nets():
    top = L.Input(shape={"dim": 1})
    for _ in range(3000):
        top = L.ReLU(top)
    assert top.to_proto().layer[-1].name == "ReLU3000"


def test_options_of_the_layer_and_of_its_block():
    """A block may be given as a dict; include, name and similar options belong to the layer."""
    n = caffe.NetSpec()
    n.data = L.Input(
        input_param={"shape": [{"dim": [1, 2]}]}, include={"phase": caffe.TEST}, name="in"
    )
    n.my = L.Python(n.data, module="mine", layer="My", param_str="x")
    data, my = n.to_proto().layer
    assert data.name == "in"
    assert data.include[0].phase == caffe.TEST
    assert list(data.input_param.shape[0].dim) == [1, 2]
    assert (my.python_param.module, my.python_param.layer, my.python_param.param_str) == (
        "mine",
        "My",
        "x",
    )


def test_a_netspec_has_items_too():
    n = caffe.NetSpec()
    n["conv1/relu"] = L.Input(shape={"dim": 1})
    assert n["conv1/relu"] is n.tops["conv1/relu"]
    assert list(n.tops) == ["conv1/relu"]
    assert n.to_proto().layer[0].name == "conv1/relu"
    assert not hasattr(n, "conv")
    assert list(copy.copy(n).tops) == ["conv1/relu"]


def test_blocks_by_type():
    names = param_name_dict()
    assert names["InnerProduct"] == "inner_product"
    assert names["HDF5Data"] == "hdf5_data"
    assert names["LRN"] == "lrn"


def test_assign_proto():
    """Lists fill repeated fields, dicts fill messages; a single value is a list of one."""
    layer = caffe_pb2.LayerParameter()
    assign_proto(layer, "param", [{"lr_mult": 0}, {"name": "w"}])
    assign_proto(
        layer,
        "convolution_param",
        {"kernel_size": (3, 5), "weight_filler": {"type": "constant", "value": 2}},
    )
    assign_proto(layer, "loss_weight", np.float32(0.5))
    assign_proto(layer, "include", [])
    assert [(p.lr_mult, p.name) for p in layer.param] == [(0, ""), (1, "w")]
    assert list(layer.convolution_param.kernel_size) == [3, 5]
    assert layer.convolution_param.weight_filler.value == 2
    assert list(layer.loss_weight) == [0.5]
    assert len(layer.include) == 0
    assign_proto(layer, "power_param", caffe_pb2.PowerParameter(power=3))
    assert layer.power_param.power == 3


def test_names_of_python_protocols_are_not_layers_or_parameters():
    assert not hasattr(P, "__path__")
    assert not hasattr(L, "__path__")
    assert not hasattr(P.Pooling, "__len__")


def test_nets_of_forks_are_written() -> None:
    """Readers and losses of forks, whose layers are not ours, with enums and messages
    inside messages.
    """
    n = caffe.NetSpec()
    n.data, n.label = L.DenseImageData(
        dense_image_data_param={"source": "list.txt", "batch_size": 4}, ntop=2
    )
    n.boxes, n.of_boxes = L.AnnotatedData(
        annotated_data_param={"batch_sampler": [{"max_sample": 1, "sampler": {"min_scale": 0.5}}]},
        transform_param={
            "resize_param": {"resize_mode": P.Resize.WARP, "interp_mode": [P.Resize.LINEAR]}
        },
        ntop=2,
    )
    kinds = {"loc_loss_type": P.MultiBoxLoss.SMOOTH_L1, "code_type": P.PriorBox.CENTER_SIZE}
    n.loss = L.MultiBoxLoss(n.boxes, n.of_boxes, **kinds)
    n.crf = L.MultiStageMeanfield(
        n.data, num_iterations=5, compatibility_mode=P.MultiStageMeanfield.POTTS
    )
    n.joints = L.CPMData(
        cpm_transform_param={"stride": 8}, data_param={"source": "lmdb", "batch_size": 2}
    )
    text = str(n.to_proto())
    assert 'dense_image_data_param {\n    source: "list.txt"\n    batch_size: 4\n  }' in text
    assert (
        "multibox_loss_param {\n    loc_loss_type: SMOOTH_L1\n    code_type: CENTER_SIZE\n  }"
        in text
    )
    assert text_format.Parse(text, caffe_pb2.NetParameter()) == n.to_proto()


def test_a_netspec_has_the_methods_of_ssd() -> None:
    n = caffe.NetSpec()
    n.x, n.y = L.Input(shape={"dim": 1}), L.Input(shape={"dim": 1})
    n.z = L.Power(n.x, scale=2)
    n.update("z", {"scale": 3})
    del n["y"]
    assert (n.keys(), n.vals()) == (["x", "z"], [n.x, n.z])
    assert n.to_proto().layer[1].power_param.scale == 3
