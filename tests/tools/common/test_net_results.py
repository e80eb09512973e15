"""tools/common/net_results.py: the values of each image, as lines and as one array."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

import netlib
from netlib.errors import NetlibError
from tests.support.nets import inputs
from tools.common.net_images import Preprocessing
from tools.common.net_results import Confusion, Results, Shown

SHOWN = Shown()
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
    """``results_of(blob, shown, labels)`` of a net with a Softmax and a DetectionOutput."""
    net = net_of(NET, netlib.TEST)
    return lambda blob, shown=SHOWN, labels=None: Results(
        net, blob, labels, "labels.txt", shown, STEPS
    )


def test_detections_of_several_passes(results_of: Callable[..., Results]) -> None:
    """Rows belong to the image that their item names; an image may have none, and a row of -1
    is no detection.
    """
    results = results_of("found")
    rows = np.array([[1, 1, 0.9, 0.1, 0.2, 0.3, 0.4], [1, 1, 0.5, 0, 0, 1, 1]], np.float32)
    first, second = results.add(rows[None, None], 2)
    assert len(first) == 0
    assert np.array_equal(second, rows)
    (nothing,) = results.add(np.array([[0, *[-1] * 6]], np.float32)[None, None], 1)
    assert results.array().shape == (1, 1, 3, 7)
    assert results.array()[0, 0, :, 0].tolist() == [1, 1, 2]
    shape = (100, 200, 3)
    assert list(results.lines(nothing, shape)) == ["found: 0 detections"]
    expected = ["found: 2 detections", "  0.9000  class 1  20 20 60 40"]
    assert list(results_of("found", Shown(1)).lines(second, shape)) == expected
    assert len(list(results_of("found", Shown(None, 0.5)).lines(second, shape))) == 3


@pytest.mark.parametrize(
    "image", [np.zeros((100, 200, 3), np.uint8), np.zeros((100, 200, 1), np.uint8)]
)
def test_detections_in_the_picture(
    results_of: Callable[..., Results], image: NDArray[np.uint8]
) -> None:
    """Each class has its colour, along the sides of the box and behind its name; the rest
    stays as it is.
    """
    labels = ["background", "hand"]
    rows = np.array([[0, 1, 0.9, 0.25, 0.5, 0.75, 0.9], [0, 0, 0.4, -1, 0, 9, 0.2]], np.float32)
    picture = results_of("found", Shown(None, 0.5), labels).drawn(rows, image)
    assert picture.shape == (100, 200, 3)
    assert not image.any()
    seen = picture.any(axis=2)
    top = seen[50, 50:150]
    bottom = seen[90, 50:150]
    left = seen[50:90, 50]
    right = seen[50:90, 150]
    assert all(side.all() for side in (top, bottom, left, right))
    assert not seen[55:85, 55:145].any()
    assert not seen[:, :45].any()
    assert not seen[94:].any()
    assert (picture == 255).all(axis=2)[:50].any()  # the name above the box
    both = results_of("found", Shown(), labels).drawn(rows, image)
    assert len({tuple(both[80, 50]), tuple(both[20, 100])}) == 2


@pytest.mark.parametrize(
    ("names", "lines"),
    [
        (
            ["a", "b"],
            [
                "true \\ found  a  b",
                "a             2  1",
                "b             0  1",
                "accuracy 0.7500 (3 of 4)",
            ],
        ),
        ([*map(str, range(30))], ["0 taken for 1: 1", "accuracy 0.7500 (3 of 4)"]),
    ],
)
def test_confusion(names: list[str], lines: list[str]) -> None:
    found = Confusion(names)
    for truth, best in ((0, 0), (0, 0), (0, 1), (1, 1)):
        found.add("x", truth, np.eye(len(names))[best])
    assert list(found.lines()) == lines
    with pytest.raises(
        NetlibError, match=f"x: its label is {len(names)}; expected 0 to {len(names) - 1}"
    ):
        found.add("x", len(names), np.zeros(len(names)))


def test_a_single_predicted_class_is_reported() -> None:
    found = Confusion(["cat", "dog"])
    for truth in (0, 1):
        found.add("x", truth, np.array([0.1, 0.9]))
    assert list(found.lines())[-1].startswith(
        "all images were taken for 'dog': are the mean, the scale"
    )


def test_classes(results_of: Callable[..., Results]) -> None:
    """The classes of a Softmax are printed best first; other blobs by their range, unless
    there are labels.
    """
    scores = np.array([[0.25, 0.75]], np.float32)
    results = results_of("soft")
    (found,) = results.add(scores, 1)
    assert list(results.lines(found, (1, 1, 3))) == [
        "soft",
        "  0.7500  class 1",
        "  0.2500  class 0",
    ]
    results = results_of("conf")
    assert list(results.lines(results.add(scores, 1)[0], (1, 1, 3))) == [
        "conf (2,), values from 0.25 to 0.75, mean 0.5"
    ]
    results = results_of("conf", Shown(1), ["cat", "dog"])
    (found,) = results.add(scores, 1)
    assert list(results.lines(found, (1, 1, 3))) == ["conf", "  0.7500  dog"]


def test_a_blob_without_images(results_of: Callable[..., Results]) -> None:
    with pytest.raises(NetlibError, match=r"blob 'prior' has shape \(1, 2, 400\) for 3 images"):
        results_of("prior").add(np.zeros((1, 2, 400), np.float32), 3)
