"""handpose/sensor.py"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from handpose.camera import NYU
from handpose.sensor import Sensor, sense


def slope() -> np.ndarray:
    """Two frames of a slanted plate before the background, mm."""
    depth = np.full((2, 128, 128), 950, np.float32)
    depth[:, 30:90, 40:100] = np.linspace(700, 850, 60, dtype=np.float32)
    return depth


def test_sensor_without_faults_is_exact_to_its_step() -> None:
    """With every fault at 0 only the rounding of the disparity is left."""
    perfect = Sensor((0, 0), (0, 0), 75.0, (0, 0), 0.125, 15.0, (0, 0), (0, 0))
    read = sense(np.random.default_rng(0), slope(), np.array([950.0, 950.0]), perfect, NYU)
    seen = slope() < 950
    assert (read[~seen] == 950).all()
    disparity = NYU.fx * 75.0 / read[seen]
    np.testing.assert_allclose(disparity * 8, np.rint(disparity * 8), atol=1e-3)
    assert np.abs(disparity - NYU.fx * 75.0 / slope()[seen]).max() <= 1 / 16 + 1e-4


def test_sensor_noise() -> None:
    """The default sensor moves depths by a few mm, drops few pixels, and only near edges of the outline."""
    read = sense(np.random.default_rng(0), slope(), np.array([950.0, 950.0]), Sensor(), NYU)
    inner = (slice(None), slice(36, 84), slice(46, 94))
    assert 0.1 < np.abs(read[inner] - slope()[inner]).mean() < 4
    assert (read[inner] < 950).all()
    assert (read[:, :24] == 950).all() and (read[:, :, :34] == 950).all()
    assert 0.8 < (read < 950).sum() / (slope() < 950).sum() < 1.1


def test_holes() -> None:
    """A dropped pixel reads as the background."""
    holey = replace(Sensor(), holes=(1.0, 1.0), dropout=(1.0, 1.0))
    read = sense(np.random.default_rng(0), slope(), np.array([950.0, 950.0]), holey, NYU)
    assert (read < 950).sum() < (slope() < 950).sum() * 0.95
    assert read.max() == 950
