"""handpose/synthetic/sensor.py"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from handpose.frames.cameras import NYU
from handpose.synthetic.sensor import NOISY_KINECT, Sensor, sense

FAR = np.array([950.0, 950.0])
PERFECT = Sensor(
    pixel_shift=(0, 0),
    block_shift=(0, 0),
    disparity_noise=(0, 0),
    disparity_step=0.125,
    dropout=(0, 0),
    holes=(0, 0),
)


def read_of(depth: np.ndarray, *pixel: float, far: np.ndarray = FAR, **faults: Any) -> np.ndarray:
    """What a sensor with these faults alone reads; the same random numbers every time."""
    rng, sensor = np.random.default_rng(0), replace(PERFECT, **faults)
    return sense(rng, depth, far[: len(depth)], sensor, NYU, *pixel)


def slope() -> np.ndarray:
    """Two frames of a slanted plate in front of the background, in mm."""
    depth = np.full((2, 128, 128), 950, np.float32)
    depth[:, 30:90, 40:100] = np.linspace(700, 850, 60, dtype=np.float32)
    return depth


def test_sensor_without_faults_is_exact_to_its_step() -> None:
    """Without faults, only the rounding of the disparity changes the depth."""
    read = read_of(slope())
    seen = slope() < 950
    assert (read[~seen] == 950).all()
    disparity = NYU.fx * 75.0 / read[seen]
    assert_allclose(disparity * 8, np.rint(disparity * 8), atol=1e-3)
    assert np.abs(disparity - NYU.fx * 75.0 / slope()[seen]).max() <= 1 / 16 + 1e-4


def edges(depth: np.ndarray) -> np.ndarray:
    """Pixels with a neighbour that differs by more than a sensor's 15 mm."""
    cross = cv2.getStructuringElement(cv2.MORPH_CROSS, (3, 3))
    above = [cv2.dilate(one, cross) - one for one in depth]
    below = [one - cv2.erode(one, cross) for one in depth]
    return np.maximum(above, below) > 15


def test_dropped_pixels() -> None:
    whole = read_of(slope())
    at_edge = edges(whole) & (whole < 950)
    assert at_edge.sum() == 2 * (4 * 60 - 4)  # the outline of the plate
    for dropout in (0, 1 / 3, 1):
        read = read_of(slope(), dropout=(dropout, dropout))
        dropped = read != whole
        assert (read[dropped] == 950).all() and not (dropped & ~at_edge).any()
        most = 0.1 if 0 < dropout < 1 else 0
        assert dropped.sum() / at_edge.sum() == pytest.approx(dropout, abs=most)


def test_holes() -> None:
    """Holes are 3 x 3 pixels about one at an edge, and read as each frame's own background."""
    whole = read_of(slope())
    far = np.array([950.0, 1200.0])
    read = read_of(slope(), far=far, holes=(1.0, 1.0))
    around = [cv2.dilate(one.astype(np.uint8), np.ones((3, 3))) > 0 for one in edges(whole)]
    assert_array_equal(read[0][around[0]], 950)
    assert_array_equal(read[0][~around[0]], whole[0][~around[0]])
    assert (read[1][around[1]] == 1200).all()
    few = read_of(slope(), holes=(0.01, 0.01))
    assert 0 < (few != whole).sum() <= 9 * 0.03 * edges(whole).sum()


def test_time_of_flight() -> None:
    """Noise grows with the squared depth and is rounded to mm; without other faults
    nothing else changes.
    """
    far = np.array([1100.0])
    for mm, deviation in ((500, 1.0), (1000, 4.0)):
        plate = np.full((1, 64, 64), mm, np.float32)
        read = read_of(plate, far=far, baseline=0.0, depth_noise=(4.0, 4.0))
        assert (read - plate).std() == pytest.approx(deviation, rel=0.1)
        assert (read == np.rint(read)).all()


def test_flying_pixels() -> None:
    depth = np.full((1, 64, 64), 950, np.float32)
    depth[:, 10:50, 10:30], depth[:, 10:50, 30:50] = 600, 700
    read = read_of(depth, baseline=0.0, flying=(1.0, 1.0))
    between = (read > 605) & (read < 695)
    assert 5 < between.sum() < 70
    assert set(np.nonzero(between)[2].tolist()) <= {29, 30}
    assert (read[depth == 950] == 950).all()


def test_a_settled_sensor_is_one_camera() -> None:
    """A settled sensor has levels within the bounds that are constant over frames and differ
    between cameras.
    """
    one, other = (NOISY_KINECT.settled(np.random.default_rng(seed)) for seed in (0, 1))
    for name, bounds in vars(NOISY_KINECT).items():
        own = getattr(one, name)
        if isinstance(bounds, tuple):
            assert bounds[0] <= own[0] == own[1] <= bounds[1]
        else:
            assert own == bounds
    assert one.dropout != other.dropout


def test_near_surfaces_spread() -> None:
    """A plate covers the given number of image pixels around it, and its own depths
    are unchanged.
    """
    depth = np.full((1, 128, 128), 950, np.float32)
    depth[:, 40:80, 40:80] = 700
    for pixel, rows in ((1.0, 2), (0.6, 1), (0.4, 0)):
        read = read_of(depth, pixel, spread=(2.0, 2.0), disparity_step=1e-4)
        covered = np.flatnonzero(read[0, :, 60] < 900)
        assert covered.min() == 40 - rows and covered.max() == 79 + rows
        assert_allclose(read[0, covered, 60], 700, atol=0.1)
