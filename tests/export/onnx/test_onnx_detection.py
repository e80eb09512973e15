"""export/onnx/vision.py: prior boxes, and detections with all options, with onnxruntime."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

import netlib
from export.onnx.check import differences
from export.onnx.net import load, onnx_image
from netlib.errors import LayerError
from netlib.files.paths import ROOT
from tests.support.onnx_nets import check_older, run_onnx

SMALL = ROOT / "tests/layers/detection/small_ssd.prototxt"
P, C = 12, 3
SHAPES = {True: [(1, 4 * P), (1, C * P)], False: [(1, 4 * P * C), (1, C * P)]}  # by share_location


def layers(options: str, more: str = "") -> str:
    """Return a net that detects in locations x0 and confidences x1, with boxes for a map x2
    of an image x3.
    """
    return f"""
        layer {{ name: "p" type: "PriorBox" bottom: "x2" bottom: "x3" top: "p"
                prior_box_param {{ min_size: 3 max_size: 5 variance: [0.3, 0.2, 0.8, 0.9] }} }}
        layer {{ name: "d" type: "DetectionOutput" bottom: "x0" bottom: "x1" bottom: "p" top: "d"
                detection_output_param {{ num_classes: {C} {options} }} }} {more}"""


def detector(files, options: str, shared: bool = True, more: str = "") -> netlib.Net:
    """Load such a net."""
    return load(*files(layers(options, more), *SHAPES[shared], (1, 2, 2, 3), (1, 3, 8, 12)))


@pytest.mark.parametrize("code", ["CORNER", "CORNER_SIZE", "CENTER_SIZE"])
@pytest.mark.parametrize("shared", [True, False])
@pytest.mark.parametrize(
    "more",
    [
        "",
        "nms_param { nms_threshold: 0.45 top_k: 5 } keep_top_k: 6",
        "keep_top_k: 7 variance_encoded_in_target: true",
        "nms_param { nms_threshold: 0 } background_label_id: 1 clip: true",
        "nms_param { nms_threshold: 2 top_k: 100 } background_label_id: -1 keep_top_k: 100",
        "confidence_threshold: 0.5 nms_param { top_k: 3 } keep_top_k: 1",
    ],
)
def test_detections(code, shared, more, files):
    """The same rows in the same order, for batches of 1 and 3."""
    options = f"code_type: {code} share_location: {str(shared).lower()} {more}"
    net = detector(files, options, shared)
    found, _ = differences(onnx_image(net), net, (1, 3))
    assert set(found) == {"d"} and found["d"].found <= 1e-5, found
    check_older(net)


def nearly_equal(files, threshold: float) -> netlib.Net:
    """Load a net whose confidences, for inputs of 0, are the parameters of a layer."""
    options = f"code_type: CENTER_SIZE nms_param {{ nms_threshold: {threshold} }}"
    bias = 'layer { name: "b" type: "Bias" bottom: "x1" top: "c" bias_param { } }'
    text = bias + layers(options).replace('"x1" bottom: "p"', '"c" bottom: "p"')
    return load(*files(text, *SHAPES[True], (1, 2, 2, 3), (1, 3, 8, 12)))


def test_confidences_that_differ_by_rounding(files, monkeypatch):
    """Confidences that are equal up to rounding may be sorted in another order; another selection
    is a difference.
    """
    monkeypatch.setattr(
        "export.onnx.check._random",
        lambda net, name, batch, rng: np.zeros((batch, *net.blobs[name].shape[1:]), np.float32),
    )
    net, order = nearly_equal(files, 0.9), np.arange(C * P) * 2e-7
    net.params["b"][0].data[...] = 0.5 + order
    image, rows = onnx_image(net), net.forward()["d"].copy()
    net.params["b"][0].data[...] = 0.5 + order[::-1]
    assert abs(net.forward()["d"] - rows).max() > 0.01
    found, _ = differences(image, net, (1, 3))
    assert found.keys() >= {"d", "c"}
    assert found["c"].found <= 1e-4
    assert found["d"].found <= 1e-5
    other = nearly_equal(files, 0)
    other.params["b"][0].data[...] = net.params["b"][0].data
    assert differences(image, other, (1, 3))[0]["d"].found > 0.01


def test_a_batch_without_detections_has_one_row_per_item(files):
    """The row has -1 in all columns but the item. In a batch with detections, an item without any
    has no row.
    """
    image = onnx_image(detector(files, "confidence_threshold: 0.5"))
    inputs = {
        f"x{i}": np.zeros((3, *shape[1:]), np.float32)
        for i, shape in enumerate([*SHAPES[True], (1, 2, 2, 3), (1, 3, 8, 12)])
    }
    assert run_onnx(image, **inputs)["d"].tolist() == [[[[item] + [-1] * 6 for item in range(3)]]]
    inputs["x1"][1, 1] = 1
    assert run_onnx(image, **inputs)["d"][0, 0, :, :3].tolist() == [[1, 1, 1]]


def test_equal_confidences(files, rng):
    """Of equal confidences the first comes first, also where top_k and keep_top_k cut."""
    net = detector(files, "nms_param { nms_threshold: 1 top_k: 9 } keep_top_k: 12")
    image = onnx_image(net)
    inputs = {
        name: rng.uniform(-1, 1, net.blobs[name].shape).astype(np.float32) for name in net.inputs
    }
    inputs["x1"] = rng.integers(0, 3, inputs["x1"].shape).astype(np.float32)
    assert np.allclose(run_onnx(image, **inputs)["d"], net.forward(**inputs)["d"], atol=1e-5)


def test_a_whole_detector(here):
    """The small detector with its recorded parameters finds the same, with batches of 1 and 2,
    also in OpenCV 5.
    """
    with np.load(SMALL.with_suffix(".npz")) as file:
        recorded = {name: file[name].astype(np.float32) for name in file.files}
    net = netlib.Net(SMALL, netlib.TEST)
    for name, params in net.params.items():
        for i, param in enumerate(params):
            param.data[...] = recorded[f"{name}/{i}"]
    net.save("net.caffemodel")
    net = load(SMALL, "net.caffemodel")
    image = onnx_image(net)
    for data in (recorded["data"], recorded["data"][1:], 0 * recorded["data"]):
        found, expected = run_onnx(image, data=data), net.forward(data=data)
        assert {name: y.shape for name, y in found.items()} == {
            name: y.shape for name, y in expected.items()
        }
        for name, y in expected.items():
            assert np.allclose(found[name], y, atol=1e-3), name
        # OpenCV 4 lacks operators; 5 drops boxes of the code CORNER
        if int(cv2.__version__.split(".")[0]) >= 5:
            Path("net.onnx").write_bytes(image)
            opencv = cv2.dnn.readNetFromONNX("net.onnx")
            opencv.setInput(data)
            for name, rows in zip(found, opencv.forward(list(found))):
                assert name == "corners" or np.allclose(rows, found[name], atol=1e-3), name


@pytest.mark.parametrize(
    ("options", "more", "message"),
    [
        (
            "nms_param { nms_threshold: 0.8 eta: 0.9 }",
            "",
            "layer 'd': eta below 1 cannot be exported to ONNX",
        ),
        ("keep_top_k: 0", "", "layer 'd': has no detections"),
        ("nms_param { top_k: 0 }", "", "layer 'd': has no detections"),
        (
            "",
            'layer { name: "r" type: "Power" bottom: "d" top: "r" }',
            "layer 'r': reads 'd', whose number of rows depends on values, which cannot be exported",
        ),
    ],
)
def test_refusals(options, more, message, files):
    with pytest.raises(LayerError, match=message) as raised:
        onnx_image(detector(files, options, more=more))
    assert str(raised.value).startswith("net.prototxt:")
    assert Path("net.prototxt").exists()
