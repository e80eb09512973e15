"""export/onnx/net.py and graph.py: whole nets, and their shapes."""

import numpy as np
import pytest
from numpy.testing import assert_equal

import netlib
from export.onnx.check import differences
from export.onnx.net import load, onnx_image
from netlib.errors import NetlibError
from tests.support.onnx_nets import IMAGE, SYNTHETIC, run_onnx


def test_layers_in_place_keep_the_name_for_the_last_value(files, onnx):
    """A blob that never changes may have two names."""
    net = load(
        *files(
            'layer { name: "ip" type: "InnerProduct" bottom: "x0" top: "y" inner_product_param { num_output: 3 } }'
            'layer { name: "relu" type: "ReLU" bottom: "y" top: "y" }'
            'layer { name: "drop" type: "Dropout" bottom: "y" top: "y" }'
            'layer { name: "power" type: "Power" bottom: "y" top: "y" power_param { shift: 1 } }'
            'layer { name: "same" type: "Dropout" bottom: "y" top: "z" }'
            'layer { name: "exp" type: "Exp" bottom: "y" top: "e" }',
            (1, 4),
        )
    )
    image = onnx_image(net, ["y"])
    outputs, layers = differences(image, net, (1, 3))
    assert max(difference.found for difference in outputs.values()) <= 1e-6
    assert max(difference.found for difference in layers.values()) <= 1e-6
    graph = onnx.load_from_string(image).graph
    assert [(node.op_type, *node.output) for node in graph.node] == [
        ("Gemm", "ip/Gemm"),
        ("Relu", "relu/Relu"),
        ("Add", "z"),
        ("Exp", "e"),
        ("Identity", "y"),
    ]


def test_a_net_in_use_keeps_its_shapes(files):
    path, _ = files('layer { name: "a" type: "AbsVal" bottom: "x0" top: "y" }', (5, 3))
    net = netlib.Net(path, netlib.TEST)
    onnx_image(net)
    assert net.blobs["y"].shape == (5, 3)


def test_a_type_without_an_onnx_form_is_rejected(files):
    path, _ = files('layer { name: "bad" type: "PhysLimit" bottom: "x0" top: "y" }', (1, 47))
    message = "layer 'bad': type 'PhysLimit' cannot be exported to ONNX"
    with pytest.raises(NetlibError, match=message):
        onnx_image(netlib.Net(path, netlib.TEST))


def test_weights_over_the_limit_are_rejected(monkeypatch):
    monkeypatch.setattr("export.onnx.graph.MAX_BYTES", 1000)
    net = load(SYNTHETIC / "deploy.prototxt", SYNTHETIC / "synthetic_hand.caffemodel.h5")
    message = r"^net 'SyntheticHand' has 0\.0 GB of weights; expected at most"
    with pytest.raises(NetlibError, match=message):
        onnx_image(net)


def test_equal_maxima_are_resolved_as_in_netlib(files):
    """Of equal maxima, ArgMax takes the last and the mask of MAX the first."""
    net = load(
        *files(
            'layer { name: "a" type: "ArgMax" bottom: "x0" top: "a" argmax_param { top_k: 3 } }'
            'layer { name: "p" type: "Pooling" bottom: "x0" top: "y" top: "mask" pooling_param { kernel_size: 2 } }',
            (1, 2, 3, 2),
        )
    )
    x = np.zeros((2, 2, 3, 2), np.float32)
    x[:, 1, 1] = 1
    found = run_onnx(onnx_image(net), x0=x)
    assert found["a"].tolist() == [[[[9], [8], [11]]]] * 2
    assert found["mask"].tolist() == [[[[0], [2]], [[2], [2]]]] * 2
    assert_equal(found, net.forward(x0=x))


def test_silence_and_splits_are_no_operators(files, onnx):
    """A blob with two consumers is not copied."""
    net = load(
        *files(
            'layer { name: "a" type: "TanH" bottom: "x0" top: "a" }'
            'layer { name: "b" type: "AbsVal" bottom: "a" top: "b" }'
            'layer { name: "c" type: "BNLL" bottom: "a" top: "c" }'
            'layer { name: "s" type: "Silence" bottom: "c" }',
            (1, 4),
        )
    )
    graph = onnx.load_from_string(onnx_image(net)).graph
    assert [(node.op_type, *node.input) for node in graph.node] == [
        ("Tanh", "x0"),
        ("Abs", "a"),
        ("Softplus", "a"),
    ]
    assert [output.name for output in graph.output] == ["b"]


@pytest.mark.parametrize("kernel", ["kernel_size: 2 stride: 2", "kernel_size: 3 stride: 2"])
def test_upsampling_with_a_mask_computes_the_same(kernel, files):
    """Also where the windows of the Pooling overlap."""
    options = "upsample_param { upsample_h: 7 upsample_w: 6 }"
    net = load(
        *files(
            f'layer {{ name: "p" type: "Pooling" bottom: "x0" top: "p" top: "mask" pooling_param {{ {kernel} }} }}'
            f'layer {{ name: "u" type: "Upsample" bottom: "p" bottom: "mask" top: "y" {options} }}',
            IMAGE,
        )
    )
    found, _ = differences(onnx_image(net), net, (1, 3))
    assert set(found) == {"y"}
    assert found["y"].found <= 1e-5
