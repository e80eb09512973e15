"""handpose/frames/lens.py: the map equals OpenCV's; the inverse; invalid lenses."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

from handpose.frames.cameras import Camera
from handpose.frames.lens import Lens, Undistorter, lens_of
from netlib.errors import DataError

CAMERA = Camera("own", 100.0, 104.0, 78.0, 62.0, 160, 120)
LENSES = [
    (0.1, -0.05, 0.002, -0.003),
    (0.1, -0.05, 0.002, -0.003, 0.01),
    (0.55, 0.1, -0.0005, 0.0002, 0.006, 0.9, 0.17, 0.03),  # approximately an Azure Kinect's
]


def numbered() -> np.ndarray:
    """An image whose pixels are all different and not 0."""
    return np.arange(1, CAMERA.width * CAMERA.height + 1, dtype=np.float32).reshape(
        CAMERA.height, CAMERA.width
    )


@pytest.mark.parametrize("coefficients", LENSES, ids=len)
def test_the_same_map_as_opencvs(coefficients: tuple[float, ...]) -> None:
    """The pixel is the nearest to the place in cv2.initUndistortRectifyMap, or 0
    outside the image.
    """
    matrix = np.array([[CAMERA.fx, 0, CAMERA.u0], [0, CAMERA.fy, CAMERA.v0], [0, 0, 1]])
    u, v = cv2.initUndistortRectifyMap(
        matrix, np.array(coefficients), None, matrix, (CAMERA.width, CAMERA.height), cv2.CV_32FC1
    )
    # otherwise either neighbour is valid
    clear = (abs(u % 1 - 0.5) > 1e-3) & (abs(v % 1 - 0.5) > 1e-3)
    column, row = np.rint(u).astype(int), np.rint(v).astype(int)
    inside = (column >= 0) & (column < CAMERA.width)
    inside &= (row >= 0) & (row < CAMERA.height)
    expected = np.where(inside, row * CAMERA.width + column + 1, 0)
    straight = Undistorter(CAMERA, Lens(coefficients))(numbered())
    assert clear.mean() > 0.98 and inside.mean() > 0.5
    assert_array_equal(straight[clear], expected[clear])


def test_no_distortion_changes_nothing() -> None:
    for lens in (Lens(), Lens((0, 0, 0, 0, 0))):
        assert lens.is_straight
        assert_array_equal(Undistorter(CAMERA, lens)(numbered()), numbered())


@given(
    st.tuples(
        st.floats(-0.1, 0.2), st.floats(-0.02, 0.05), st.floats(-0.01, 0.01), st.floats(-0.01, 0.01)
    )
)
def test_the_inverse_lens_is_the_inverse(coefficients: tuple[float, ...]) -> None:
    x, y = np.meshgrid(np.linspace(-0.6, 0.6, 9), np.linspace(-0.5, 0.5, 7))
    there = Lens(coefficients, "inverse_brown_conrady").distorted(x, y)
    back = Lens(coefficients).distorted(*there)
    assert_allclose(back, (x, y), atol=1e-4)


def test_pixels_beyond_a_fold_of_the_lens_become_0() -> None:
    """With k1 = -1/3 the formula folds back at slope 1; rays beyond it are not in the image."""
    wide = Camera("own", 40.0, 40.0, 79.5, 59.5, 160, 120)
    straight = Undistorter(wide, Lens((-1 / 3, 0, 0, 0)))(numbered())
    assert straight[60, 80] > 0 and straight[60, 80 + 38] > 0
    assert not straight[60, 80 + 42 :].any() and not straight[:18].any()


@pytest.mark.parametrize(
    ("model", "coefficients", "lens"),
    [
        ("Brown Conrady", (0.1, 0, 0, 0, 0), Lens((0.1, 0, 0, 0, 0))),
        (
            "distortion.inverse_brown_conrady",
            (0.1, 0, 0, 0, 0),
            Lens((0.1, 0, 0, 0, 0), "inverse_brown_conrady"),
        ),
        ("rational_polynomial", (0.1, 0, 0, 0, 0, 0, 0, 0.2), Lens((0.1, 0, 0, 0, 0, 0, 0, 0.2))),
        ("plumb_bob", (0.1, *[0.0] * 13), Lens((0.1, *[0.0] * 7))),
        ("fisheye", (0, 0, 0, 0), Lens()),
        ("None", (), Lens()),
    ],
)
def test_names_of_models(model: str, coefficients: tuple[float, ...], lens: Lens) -> None:
    """Names as in RealSense, ROS and OpenCV are accepted; without distortion any name is."""
    assert lens_of(model, coefficients, "x") == lens


def test_a_lens_of_an_unknown_model_is_rejected() -> None:
    with pytest.raises(DataError, match="lens model 'fisheye', expected brown_conrady or inv"):
        Lens((0.1, 0, 0, 0), "fisheye")  # type: ignore[arg-type]
