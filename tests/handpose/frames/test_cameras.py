"""handpose/frames/cameras.py"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

from handpose.frames.cameras import CAMERAS, NYU, VIEWS, Camera, View
from netlib.errors import DataError


def test_axes() -> None:
    """The optical axis meets the principal point; right is +x and +u; up is +y and a smaller v."""
    assert_allclose(NYU.project([0, 0, 800]), [320, 240, 800])
    u, v, d = NYU.project([100, 50, 1000])
    assert (u, v, d) == pytest.approx((320 + 58.803, 240 - 29.3535, 1000))


@pytest.mark.parametrize("camera", CAMERAS.values(), ids=CAMERAS)
@given(x=st.floats(-500, 500), y=st.floats(-500, 500), z=st.floats(100, 5000))
def test_round_trip(camera: Camera, x: float, y: float, z: float) -> None:
    points = np.broadcast_to([x, y, z], (2, 3, 3))
    assert_allclose(camera.unproject(camera.project(points)), points, atol=1e-9)


def test_pixels_of_the_image() -> None:
    """Of whole numbers and others, also of a row of columns and a column of rows."""
    columns, rows = np.array([-1, 0, 639, 640]), np.array([-0.5, 0, 479.5, 480])
    in_image = [False, True, True, False]
    assert NYU.has_pixel(columns, np.zeros(4)).tolist() == in_image
    assert NYU.has_pixel(np.zeros(4), rows).tolist() == in_image
    assert_array_equal(NYU.has_pixel(columns, rows[:, None]), np.outer(in_image, in_image))


def test_minimum_range() -> None:
    """Readings nearer than the minimum range become 0; an image without such readings is
    returned unchanged.
    """
    depth = np.array([[0, 199, 200, 900, -1]], np.int16)
    assert_array_equal(NYU.in_range(depth), [[0, 0, 200, 900, -1]])
    assert replace(NYU, min_range_mm=100.0).in_range(depth) is depth


@pytest.mark.parametrize("view", VIEWS.values(), ids=VIEWS)
def test_models_by_their_field_of_view(view: View) -> None:
    """In frames of one shape it does not depend on their size; other shapes are refused."""
    size = {"azure": (640, 576), "femto": (640, 576)}.get(view.name, (640, 480))
    large, small = view.at(*size), view.at(*(n // 2 for n in size))
    assert large.fx == large.fy == pytest.approx(2 * small.fx) and 350 < large.fx < 650
    assert (large.u0, large.v0) == ((size[0] - 1) / 2, (size[1] - 1) / 2)
    with pytest.raises(
        DataError, match=rf"frames of 300 x 100 px; depth frames of {view.name} are "
    ):
        view.at(300, 100)
