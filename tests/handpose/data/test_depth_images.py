"""handpose/data/depth_images.py"""

from __future__ import annotations

import numpy as np
import pytest

from handpose.data.depth_images import UnitError, check_unit, depth_image
from netlib.errors import DataError


def test_what_is_masked_was_not_read() -> None:
    """Another array is given back as it is."""
    image = np.array([[700, 0], [65535, 800]], np.uint16)
    assert depth_image(image) is image
    assert depth_image(np.ma.masked_equal(image, 65535)).tolist() == [[700, 0], [0, 800]]


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ([[700.0]], "depth image is a list, expected an array of numbers"),
        ("frame.png", "depth image is a str, expected an array of numbers"),
        (np.array([["a"]]), "depth image is an array of <U1, expected numbers"),
        (np.zeros((2, 2), complex), "depth image is an array of complex128, expected numbers"),
        (np.zeros((2, 2, 1)), r"depth image of shape \(2, 2, 1\), expected \(height, width\)"),
    ],
)
def test_what_is_no_image(given: object, message: str) -> None:
    """One line."""
    with pytest.raises(DataError, match=message):
        depth_image(given)


@pytest.mark.parametrize(
    ("image", "message"),
    [
        (np.array([[0.5, 0, np.nan, 1.2]]), r"depths from 0\.5 to 1\.2, expected mm; they may be metres"),
        (np.array([[700000.0, 0]]), "depths from 700000 to 700000, expected mm, nearer than 20000"),
        (np.array([[-700, 0]], np.int16), "depths from -700 to -700, expected mm, growing away from the camera"),
    ],
)
def test_other_units(image: np.ndarray, message: str) -> None:
    """Where all that was read says so."""
    with pytest.raises(UnitError, match=message):
        check_unit(image)
    check_unit(np.append(image, 700.0))


@pytest.mark.parametrize("unread", [0, -1, np.nan, np.inf])
def test_nothing_read(unread: float) -> None:
    """Says nothing of the unit."""
    check_unit(np.full((2, 2), unread))
