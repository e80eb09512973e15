"""export/onnx/net.py: the layer types that have a form in ONNX."""

import re

from export.onnx.net import LAYERS
from netlib.files.paths import ROOT
from netlib.proto.options import layer_types

WITHOUT_FORM = {"Filter", "Im2col", "LSTM", "LSTMUnit", "PSROIPooling", "RNN", "ROIPooling"}


def test_every_layer_type_has_a_form_or_is_refused():
    """Every layer type has an ONNX form, or is one of those known to have none."""
    random_or_from_outside = {"DummyData", "HDF5Data", "HandAugment", "Data", "ImageData", "MemoryData",
                              "HDF5Output"}
    of_training = {"Accuracy", "DeepHandModelDofConstraintLoss", "PhysLimit"}
    refused = {name for name in layer_types() if name not in LAYERS and not name.endswith("Loss")}
    assert refused - {"DeepHandModelDofConstraintLoss"} <= random_or_from_outside | of_training | WITHOUT_FORM


def test_the_document_names_every_layer_type():
    """docs/onnx.md names every layer type with an ONNX form, and those without that a reader may look for."""
    text = (ROOT / "docs" / "onnx.md").read_text(encoding="utf-8")
    for name in {*LAYERS, *WITHOUT_FORM}:
        assert re.search(rf"\b{name}\b", text), name
