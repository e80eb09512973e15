"""handpose/synthetic/frame_errors.py"""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from handpose.synthetic.frame_errors import enlarged, measure_fine, measure_frame
from netlib.blob import Array


@pytest.fixture
def view() -> tuple[Array, Array, Array]:
    """A palm of 40 x 40 pixels in front of a wall: depth, whether a pixel is the hand's, and the
    light that surfaces send back.
    """
    depth = np.full((96, 96), 1200, np.float32)
    depth[30:70, 30:70] = 800
    return depth, depth == 800, np.ones_like(depth)


def test_a_view_with_as_many_pixels_as_the_camera_is_a_frame(view: tuple[Array, ...]) -> None:
    depth, hand, reflects = view
    rng = np.random.default_rng(3)
    rng.uniform()  # the camera's focal length
    frame = measure_frame(rng, depth, hand, 100.0, reflects)
    fine = measure_fine(np.random.default_rng(3), depth, hand, 100.0, reflects)
    assert_array_equal(fine, frame)


def test_a_view_with_more_pixels_repeats_or_interpolates_those_of_the_camera(
    view: tuple[Array, ...],
) -> None:
    """At a focal length of 600 px it has those of a camera with 150 to 300 px two to four times."""
    depth, hand, reflects = view
    views = [
        measure_fine(np.random.default_rng(seed), depth, hand, 600.0, reflects)
        for seed in range(12)
    ]
    repeated = [(np.diff(image, axis=1) == 0).all(axis=0).mean() for image in views]
    assert 0 < np.mean(np.greater(repeated, 0.49)) < 1
    palms = np.stack(views)[:, 40:60, 40:60]
    assert (palms > 0).mean() > 0.7
    assert np.abs(np.median(palms[palms > 0]) - 800) < 5


def test_enlarged_frames_repeat_pixels_or_interpolate_within_surfaces() -> None:
    """Across an edge, and around a pixel that is not read, pixels are repeated."""
    slope = np.tile(np.linspace(500, 531, 32, dtype=np.float32), (32, 1))
    slope[:, 20:] += 300
    slope[4, 4] = 0
    repeated, interpolated = (
        enlarged(slope, (128, 128), is_interpolated) for is_interpolated in (False, True)
    )
    assert_array_equal(repeated, np.repeat(np.repeat(slope, 4, axis=0), 4, axis=1))
    steps = np.diff(interpolated, axis=1)
    assert_array_equal(interpolated[:, 76:84], repeated[:, 76:84])  # the edge
    assert_array_equal(interpolated[12:24, 12:24], repeated[12:24, 12:24])  # the missing pixel
    assert_allclose(steps[32:, 8:72], 0.25, atol=1e-3)  # the slope, without steps
