"""A small detector gives what OpenCV 4.14 gives, survives binary files, and runs
under both engines.

small_ssd.npz was recorded with OpenCV's importer: the parameters (``LAYER/INDEX``), the input and,
as ``opencv/BLOB``, the blobs that ``cv2.dnn.readNetFromCaffe("small_ssd.prototxt",
weights).forward(...)`` returned, of the detections those rows that are not zeros. The importer
sorts detections by their confidence, Caffe by label and confidence. The weights were chosen such
that no decision depends on rounding. To record again, save a net with these parameters as
.caffemodel, with norm2's scale of shape (1,), which OpenCV requires.
"""

from pathlib import Path

import numpy as np
import pytest

import netlib
from netlib.proto import messages, prototxt, wire

NET, RECORDED = (Path(__file__).with_name(f"small_ssd.{ending}") for ending in ("prototxt", "npz"))


@pytest.fixture
def recorded():
    with np.load(RECORDED) as file:
        return {name: file[name].astype(np.float32) for name in file.files}


@pytest.fixture
def net(recorded):
    """The net with the recorded parameters."""
    net = netlib.Net(NET, netlib.TEST)
    for name, params in net.params.items():
        for i, param in enumerate(params):
            param.data[...] = recorded[f"{name}/{i}"]
    return net


def sorted_rows(rows):
    """Sort rows by item, label, confidence and corners; rounding does not change the sequence."""
    return rows[np.lexsort(rows.round(4).T[[5, 4, 3, 2, 1, 0]])]


def test_the_net_agrees_with_opencv(net, recorded):
    found = net.forward(blobs=["norm1", "norm2", "loc1_perm", "priors"], data=recorded["data"])
    for name, expected in recorded.items():
        if name.startswith("opencv/"):
            y = found[name.removeprefix("opencv/")]
            if y.shape[3:] == (7,):
                y, expected = sorted_rows(y[0, 0]), sorted_rows(expected)
            assert y.shape == expected.shape, name
            assert np.abs(y - expected).max() < 1e-4 * np.abs(expected).max(), name


def test_text_and_binary_are_equivalent():
    """Encoded and decoded, the options of the fork are unchanged; protobuf's classes give
    the same bytes.
    """
    google = pytest.importorskip("google.protobuf.text_format")
    from netlib.caffe.proto import caffe_pb2

    text = NET.read_text(encoding="utf-8")
    tree = prototxt.parse(text)
    data = wire.encode(tree, messages.NetParameter)
    assert wire.encode(wire.decode(data, messages.NetParameter), messages.NetParameter) == data
    made = google.Parse(text, caffe_pb2.NetParameter())
    assert made.SerializeToString(deterministic=True) == data
    assert (
        google.Parse(str(wire.decode(data, messages.NetParameter)), caffe_pb2.NetParameter())
        == made
    )
    assert {layer.detection_output_param.code_type for layer in made.layer} >= {
        caffe_pb2.PriorBoxParameter.CENTER_SIZE
    }
