"""tools/common/net_results.py: the values of each image, as lines and as one array."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

import netlib
from netlib.errors import NetlibError
from tests.support.nets import inputs
from tools.common.net_images import Preprocessing
from tools.common.net_results import Results

STEPS = Preprocessing((10, 10), (10, 10), False, False, np.zeros((3, 1, 1)), 1.0)
NET = (
    inputs(data=(1, 3, 10, 10), loc=(1, 4), conf=(1, 2))
    + """
layer { name: "prior" type: "PriorBox" bottom: "data" bottom: "data" top: "prior" prior_box_param { min_size: 4 } }
layer { name: "soft" type: "Softmax" bottom: "conf" top: "soft" }
layer { name: "one" type: "Slice" bottom: "prior" top: "a" top: "b" slice_param { axis: 2 slice_point: 4 } }
layer { name: "found" type: "DetectionOutput" bottom: "loc" bottom: "conf" bottom: "a" top: "found"
        detection_output_param { num_classes: 2 } }
"""
)


@pytest.fixture
def results_of(net_of: Callable[..., netlib.Net]) -> Callable[..., Results]:
    """``results_of(blob, labels)`` of a net with a Softmax and a DetectionOutput."""
    return lambda blob, labels=None: Results(net_of(NET, netlib.TEST), blob, labels, "labels.txt")


def test_detections_of_several_passes(results_of: Callable[..., Results]) -> None:
    """Rows belong to the image that their item names; an image may have none, and a row of -1 is no detection."""
    results = results_of("found")
    rows = np.array([[1, 1, 0.9, 0.1, 0.2, 0.3, 0.4], [1, 1, 0.5, 0, 0, 1, 1]], np.float32)
    first, second = results.add(rows[None, None], 2)
    assert len(first) == 0 and np.array_equal(second, rows)
    (nothing,) = results.add(np.array([[0, *[-1] * 6]], np.float32)[None, None], 1)
    assert results.array().shape == (1, 1, 3, 7) and results.array()[0, 0, :, 0].tolist() == [1, 1, 2]
    expected = ["found: 2 detections", "  0.9000  class 1  20 20 60 40"]
    assert list(results.lines(second, 1, STEPS, (100, 200, 3))) == expected
    assert list(results.lines(nothing, 5, STEPS, (100, 200, 3))) == ["found: 0 detections"]


def test_classes(results_of: Callable[..., Results]) -> None:
    """The classes of a Softmax are printed best first; other blobs by their range, unless there are labels."""
    scores = np.array([[0.25, 0.75]], np.float32)
    results = results_of("soft")
    assert list(results.lines(results.add(scores, 1)[0], 5, STEPS, (1, 1, 3))) == [
        "soft", "  0.7500  class 1", "  0.2500  class 0"
    ]
    results = results_of("conf")
    assert list(results.lines(results.add(scores, 1)[0], 5, STEPS, (1, 1, 3))) == [
        "conf (2,), values from 0.25 to 0.75, mean 0.5"
    ]
    results = results_of("conf", ["cat", "dog"])
    assert list(results.lines(results.add(scores, 1)[0], 1, STEPS, (1, 1, 3))) == ["conf", "  0.7500  dog"]


def test_a_blob_without_images(results_of: Callable[..., Results]) -> None:
    with pytest.raises(NetlibError, match=r"blob 'prior' has shape \(1, 2, 400\) for 3 images"):
        results_of("prior").add(np.zeros((1, 2, 400), np.float32), 3)
