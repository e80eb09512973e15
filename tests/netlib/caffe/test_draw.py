"""caffe.draw: a net as a graph. Tests that need pydot or Graphviz are skipped without them."""

import shutil
from pathlib import Path

import pytest
from google.protobuf import text_format

import netlib.caffe as caffe
from netlib.caffe import draw
from netlib.caffe.proto import caffe_pb2
from netlib.errors import NetlibError

NET = """
name: "small net"
layer { name: "data" type: "Data" top: "data" top: "label" data_param { source: "x" batch_size: 64 }
        include { phase: TRAIN } }
layer { name: "data" type: "Input" top: "data" include { phase: TEST } }
layer { name: "conv1/3x3" type: "Convolution" bottom: "data" top: "conv1/3x3" param { lr_mult: 2 }
        convolution_param { num_output: 20 kernel_size: 3 pad: 1 } }
layer { name: "relu" type: "ReLU" bottom: "conv1/3x3" top: "conv1/3x3" }
layer { name: "pool" type: "Pooling" bottom: "conv1/3x3" top: "pool"
        pooling_param { pool: AVE kernel_size: 2 stride: 2 } }
layer { name: "drop" type: "Dropout" bottom: "pool" top: "drop" exclude { phase: TEST } }
layer { name: "node" type: "InnerProduct" bottom: "pool" top: "node" inner_product_param { num_output: 10 } }
"""


@pytest.fixture
def net():
    return text_format.Parse(NET, caffe_pb2.NetParameter())


def layer_of(text):
    return text_format.Parse(text, caffe_pb2.LayerParameter())


def test_labels_of_layers(net):
    """A label has name, type and kernel, on separate lines if the graph goes from left to right."""
    labels = [draw.get_layer_label(layer, "TB") for layer in net.layer]
    assert labels == [
        '"data (Data)"',
        '"data (Input)"',
        '"conv1/3x3 (Convolution) kernel size: 3 stride: 1 pad: 1"',
        '"relu (ReLU)"',
        '"pool (Pooling AVE) kernel size: 2 stride: 2 pad: 0"',
        '"drop (Dropout)"',
        '"node (InnerProduct)"',
    ]
    assert draw.get_layer_label(net.layer[6], "LR") == r'"node\n(InnerProduct)"'


def test_labels_with_learning_rates(net):
    assert (
        draw.get_layer_label(net.layer[6], "TB", display_lrm=True)
        == '"node (InnerProduct) lr mult: 1.0, 1.0"'
    )
    assert draw.get_layer_label(net.layer[3], "TB", display_lrm=True) == '"relu (ReLU)"'
    frozen = layer_of('name: "ip" type: "InnerProduct" param { lr_mult: 0 } param { lr_mult: 0 }')
    assert draw.get_layer_label(frozen, "TB", display_lrm=True) == '"ip (InnerProduct)"'


def test_colours_and_kinds_of_pooling():
    types = ["Convolution", "Deconvolution", "Pooling", "InnerProduct", "ReLU"]
    colours = ["#FF5050", "#FF5050", "#FF9900", "#CC33FF", "#6495ED"]
    assert [draw.choose_color_by_layertype(name) for name in types] == colours
    assert draw.get_pooling_types_dict() == {0: "MAX", 1: "AVE", 2: "STOCHASTIC"}


def text_of(net, *args, **options):
    pytest.importorskip("pydot")
    return draw.get_pydot_graph(net, *args, **options).to_string()


def test_the_graph(net):
    text = text_of(net, "TB")
    assert text.startswith('digraph "small net" {\nrankdir=TB;\n')
    # with the layer in place
    box = r'"conv1/3x3 (Convolution) kernel size: 3 stride: 1 pad: 1\nrelu (ReLU)"'
    assert f'{box} [shape=record, fillcolor="#FF5050", style=filled];\n' in text
    assert '"node (InnerProduct)" [shape=record, fillcolor="#CC33FF", style=filled];\n' in text
    assert '\n"conv1/3x3" [shape=octagon, fillcolor="#E0E0E0", style=filled];\n' in text
    assert "\nlabel [shape=octagon, " in text
    assert '\n"node" [shape=octagon, ' in text
    assert text.count('"conv1/3x3" -> ') == 1
    assert f'\n{box} -> "conv1/3x3" [label=20];\n' in text
    assert '\n"data (Data)" -> data [label="Batch 64"];\n' in text
    assert '\n"node (InnerProduct)" -> "node" [label=10];\n' in text
    assert "Batch" not in text_of(net, "TB", label_edges=False)


def test_edges_carry_shapes(net):
    """Where a blob is made; where it is read only if no layer makes it."""
    del net.layer[:2]
    text = text_of(net, "TB", shapes={"data": (1, 3, 8, 8), "pool": (1, 20, 4, 4), "node": ()})
    box = r'"conv1/3x3 (Convolution) kernel size: 3 stride: 1 pad: 1\nrelu (ReLU)"'
    assert f'\ndata -> {box} [label="1 x 3 x 8 x 8"];' in text
    assert (
        '"pool (Pooling AVE) kernel size: 2 stride: 2 pad: 0" -> pool [label="1 x 20 x 4 x 4"];'
        in text
    )
    assert 'pool -> "node (InnerProduct)" [label=""];' in text
    assert '"node (InnerProduct)" -> "node" [label=10];' in text


def test_a_layer_in_place_on_an_input(net):
    del net.layer[:3]
    assert '"relu (ReLU)" [shape=record, fillcolor="#90EE90", style=filled];\n' in text_of(
        net, "TB"
    )


@pytest.mark.parametrize(
    ("phase", "shown"),
    [
        (None, ["data (Data)", "data (Input)", "drop"]),
        (caffe.TRAIN, ["data (Data)", "drop"]),
        (caffe.TEST, ["data (Input)"]),
    ],
)
def test_phases(net, phase, shown):
    text = text_of(net, "TB", phase=phase)
    assert [name for name in ("data (Data)", "data (Input)", "drop") if f'"{name}' in text] == shown


def test_rules_without_a_phase(net):
    net.layer[3].include.add(stage=["deploy"])
    net.layer[5].exclude.add(stage=["deploy"])
    assert "relu" in text_of(net, "LR", phase=caffe.TRAIN)
    assert "drop" in text_of(net, "LR", phase=caffe.TRAIN)


def test_raw(net, here):
    """The ``raw`` format writes Graphviz's language and does not need Graphviz."""
    pytest.importorskip("pydot")
    draw.draw_net_to_file(net, "net.raw", phase=caffe.TRAIN, display_lrm=True)
    text = Path("net.raw").read_text()
    assert text.startswith('digraph "small net" {\nrankdir=LR;\n')
    assert "lr mult: 2.0, 1.0" in text


@pytest.mark.skipif(shutil.which("dot") is None, reason="Graphviz is not installed")
def test_a_picture(net, here):
    pytest.importorskip("pydot")
    draw.draw_net_to_file(net, "net.svg")
    assert "conv1/3x3" in Path("net.svg").read_text()
    assert draw.draw_net(net, "LR", "dot").startswith(b'digraph "small net" {')
    with pytest.raises(NetlibError, match=r"dot cannot draw the net as 'xyz': .*not recognized"):
        draw.draw_net_to_file(net, "net.xyz")


def test_a_dot_that_fails(net, monkeypatch, tmp_path):
    pytest.importorskip("pydot")
    program = tmp_path / "dot"
    program.write_text(
        "#!/bin/sh\ncat > /dev/null\necho 'Error: no' >&2\necho 'at all' >&2\nexit 1\n"
    )
    program.chmod(0o755)
    monkeypatch.setattr("shutil.which", lambda name: str(program))
    with pytest.raises(NetlibError, match=r"^dot cannot draw the net as 'png': Error: no at all$"):
        draw.draw_net(net, "LR")
