"""export/onnx/net.py and graph.py: whole nets, and their shapes."""

from __future__ import annotations

from pathlib import Path

import pytest

import netlib
from export.onnx.check import differences
from export.onnx.net import load, onnx_image
from netlib.errors import NetlibError
from tests.support.onnx_nets import SYNTHETIC, net_text


def test_layers_in_place(files, onnx):
    """A blob changed in place keeps its name for the last value; a blob that never changes may have two names."""
    net = load(*files(
        'layer { name: "ip" type: "InnerProduct" bottom: "x0" top: "y" inner_product_param { num_output: 3 } }'
        'layer { name: "relu" type: "ReLU" bottom: "y" top: "y" }'
        'layer { name: "drop" type: "Dropout" bottom: "y" top: "y" }'
        'layer { name: "power" type: "Power" bottom: "y" top: "y" power_param { shift: 1 } }'
        'layer { name: "same" type: "Dropout" bottom: "y" top: "z" }'
        'layer { name: "exp" type: "Exp" bottom: "y" top: "e" }',
        (1, 4),
    ))
    image = onnx_image(net, ["y"])
    outputs, layers = differences(image, net, (1, 3))
    assert max(difference.found for difference in [*outputs.values(), *layers.values()]) <= 1e-6
    graph = onnx.load_from_string(image).graph
    assert [(node.op_type, *node.output) for node in graph.node] == [
        ("Gemm", "ip/Gemm"), ("Relu", "relu/Relu"), ("Add", "z"), ("Exp", "e"), ("Identity", "y"),
    ]


def test_a_net_from_python(files):
    """A net in use can be exported: its shapes do not change, and types without an ONNX form are rejected."""
    net, _ = files('layer { name: "a" type: "AbsVal" bottom: "x0" top: "y" }', (5, 3))
    used = netlib.Net(net, netlib.TEST)
    onnx_image(used)
    assert used.blobs["y"].shape == (5, 3)
    Path("loss.prototxt").write_text(net_text('layer { name: "bad" type: "PhysLimit" bottom: "x0" top: "y" }', (1, 47)))
    with pytest.raises(NetlibError, match="layer 'bad': type 'PhysLimit' cannot be exported to ONNX"):
        onnx_image(netlib.Net("loss.prototxt", netlib.TEST))


def test_weights_over_two_gigabytes(monkeypatch):
    """Nets of more than two gigabytes, the limit of a protocol buffer, are rejected."""
    monkeypatch.setattr("export.onnx.graph.MAX_BYTES", 1000)
    net = load(SYNTHETIC / "deploy.prototxt", SYNTHETIC / "synthetic_hand.caffemodel.h5")
    with pytest.raises(NetlibError, match=r"^net 'SyntheticHand' has 0\.0 GB of weights; expected at most"):
        onnx_image(net)
