"""handpose/body/sides.py"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from handpose.body.sides import (
    MIRROR,
    SIDES,
    Side,
    SideView,
    as_right,
    camera_of,
    mirror_of,
    pixel_of,
)
from handpose.frames.cameras import ICVL


def test_mirror() -> None:
    """The mirror negates x for left hands only, and is its own inverse."""
    assert mirror_of("left") is MIRROR and MIRROR.tolist() == [-1, 1, 1]
    for side in SIDES:
        assert_array_equal(mirror_of(side) ** 2, np.ones(3))


@pytest.mark.parametrize("shape", [(3, 4), (2, 3, 4)])
def test_images(shape: tuple[int, ...]) -> None:
    """For left hands the columns are reversed, in one image and in several."""
    images = np.arange(np.prod(shape), dtype=np.float32).reshape(shape)
    assert_array_equal(as_right(images, "right"), images)
    assert_array_equal(as_right(images, "left"), np.flip(images, -1))


@pytest.mark.parametrize("side", SIDES)
def test_the_view_of_a_side_shows_the_same_points(side: Side, rng: np.random.Generator) -> None:
    """A pixel of the frame is the mirrored point in the view of a left hand."""
    depth = rng.uniform(400, 900, (240, 320)).astype(np.float32)
    frame = SideView("right", ICVL, depth, depth)
    view = frame.of(side)
    uvd = np.array([40.0, 100.0, depth[100, 40]])
    u, v, d = view_uvd = frame.pixel_in(side, uvd)
    assert view.depth[int(v), int(u)] == view.readings[int(v), int(u)] == d
    expected = ICVL.unproject(uvd) * mirror_of(side)
    assert_allclose(view.camera.unproject(view_uvd), expected, atol=1e-9)
    assert_allclose(pixel_of(uvd, ICVL, side), view_uvd)
    assert camera_of(ICVL, side) == view.camera


def test_a_view_and_back_is_the_frame() -> None:
    depth = np.arange(12.0).reshape(3, 4)
    frame = SideView("right", replace(ICVL, width=4, height=3), depth, depth + 1)
    weight = np.arange(12, dtype=np.float32).reshape(3, 4)
    left = frame.of("left").weighted(weight)
    assert_array_equal(left.weight, weight[:, ::-1])
    again = left.of("right")
    assert_array_equal(again.weight, weight)
    assert_array_equal(again.depth, depth)
    assert_array_equal(again.readings, depth + 1)
    assert again.camera == frame.camera and frame.of("right") is frame
