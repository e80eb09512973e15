"""Every layer type that has a form in ONNX, on its own: the exported layer computes the
same as netlib.
"""

import re
from pathlib import Path

import pytest

from export.onnx.check import differences
from export.onnx.net import LAYERS, load, onnx_image
from netlib.files.paths import ROOT
from netlib.proto.options import layer_types
from tests.support.onnx_nets import IMAGE, check_older
from tests.support.tables import lines_of, shape_of

EXAMPLES = lines_of(Path(__file__).parent / "layers.txt")
ELSEWHERE = {"DetectionOutput", "Input", "Silence"}  # in nets of several layers


def net_of(files, layer, bottoms="image", tops="1 top"):
    """Load the net of an example."""
    kind, _, options = layer.partition(" ")
    shapes = [IMAGE if word == "image" else shape_of(word) for word in bottoms.split()]
    ends = [f'bottom: "x{i}"' for i in range(len(shapes))]
    also = ""
    if kind == "Parameter":
        ends, also = [], 'layer { name: "read" type: "Sigmoid" bottom: "x0" top: "z" }'
    ends += [f'top: "y{i}"' for i in range(int(tops.split()[0]))]
    it = f'layer {{ name: "it" type: "{kind}" {" ".join(ends)} {options} }}'
    return load(*files(f"{it} {also}", *shapes))


@pytest.mark.parametrize("example", EXAMPLES, ids=" ".join)
def test_layer(example, files):
    """With batches of 1 and 3 it agrees with netlib to 1e-6 of the largest value."""
    net = net_of(files, *example)
    outputs, layers = differences(onnx_image(net), net, (1, 3))
    assert set(outputs) == set(net.outputs)
    check_older(net)
    found = [difference.found for difference in [*outputs.values(), *layers.values()]]
    assert max(found) <= 1e-6, (outputs, layers)


def test_every_type_has_an_example():
    assert {layer.split()[0] for layer, *_ in EXAMPLES} | ELSEWHERE == set(LAYERS)


WITHOUT_FORM = {"Filter", "Im2col", "LSTM", "LSTMUnit", "PSROIPooling", "RNN", "ROIPooling"}


def test_every_layer_type_has_a_form_or_is_refused():
    """Every layer type has an ONNX form, or is one of those known to have none."""
    random_or_from_outside = {
        "DummyData",
        "HDF5Data",
        "HandAugment",
        "Data",
        "ImageData",
        "MemoryData",
        "HDF5Output",
    }
    of_training = {"Accuracy", "PhysLimit"}
    refused = {name for name in layer_types() if name not in LAYERS and not name.endswith("Loss")}
    assert refused <= random_or_from_outside | of_training | WITHOUT_FORM


def test_the_document_names_every_layer_type():
    """docs/onnx.md names every layer type with an ONNX form, and those without that a
    reader may look for.
    """
    text = (ROOT / "docs" / "onnx.md").read_text(encoding="utf-8")
    for name in {*LAYERS, *WITHOUT_FORM}:
        assert re.search(rf"\b{name}\b", text), name
