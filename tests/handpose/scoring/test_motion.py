"""handpose/scoring/tracks.py"""

from __future__ import annotations

import numpy as np
import pytest

from handpose.scoring.tracks import bone_changes, jitter, lag_s, rests
from netlib.blob import Array

RATE = 30.0
NUMBERS = np.arange(300)
TIMES = NUMBERS / RATE
BASE = np.random.default_rng(0).uniform(-80, 80, (31, 3)) + (0, 0, 600)


def moving(times: Array) -> Array:
    """Joints (N, 31, 3) of a hand that moves back and forth."""
    way = np.array([120.0, 60.0, 40.0]) * np.sin(2 * np.pi * 0.7 * times)[:, None]
    return np.asarray(BASE + way[:, None])


@pytest.mark.parametrize("lag", [0.0, 0.04, 0.0123, -0.025])
def test_a_track_that_is_late_is_told_by_how_much(lag: float) -> None:
    """The lag is measured in seconds, more finely than a frame; a constant error does not affect it."""
    late = moving(TIMES - lag) + (3, -4, 5)
    assert lag_s(NUMBERS, TIMES, late, moving(TIMES)) == pytest.approx(lag, abs=1e-4)


def test_lag_with_noise_and_holes() -> None:
    """The lag is also found with noise, and with missing frames, which split the track."""
    kept = np.r_[0:120, 130:300]
    late = moving(TIMES - 0.04) + np.random.default_rng(1).normal(0, 2, (300, 31, 3))
    assert lag_s(NUMBERS[kept], TIMES[kept], late[kept], moving(TIMES)[kept]) == pytest.approx(0.04, abs=5e-4)


def test_nothing_moves_nothing_lags() -> None:
    """The lag of a hand at rest, of a very short track, or out of range is NaN."""
    still = np.broadcast_to(BASE, (300, 31, 3))
    assert np.isnan(lag_s(NUMBERS, TIMES, still, still))
    assert np.isnan(lag_s(NUMBERS, TIMES, moving(TIMES - 0.35), moving(TIMES)))
    assert np.isnan(lag_s(NUMBERS[:3], TIMES[:3], moving(TIMES[:3]), moving(TIMES[:3])))


def test_jitter_is_the_deviation_of_the_noise() -> None:
    """Noise of 1 / sqrt 3 mm per coordinate gives a deviation of 1 mm."""
    still = np.broadcast_to(BASE, (3000, 31, 3))
    noise = np.random.default_rng(2).normal(0, 3**-0.5, still.shape)
    found = jitter(np.arange(3000), np.arange(3000) / RATE, still + noise + (9, 9, 9), still)
    assert found.deviation_mm == pytest.approx(1.0, abs=0.01)
    assert 2900 < found.frames <= 3000 - 12


def test_jitter_by_hand() -> None:
    """With every other frame moved by 1 mm, a window of 15 frames has 7 of them, and the figures follow by hand."""
    still = np.broadcast_to(BASE, (42, 31, 3))
    tracked = still.copy()
    tracked[::2, :, 0] += 1.0
    found = jitter(np.arange(42), np.arange(42) / RATE, tracked, still)
    assert found.frames == 30
    assert found.deviation_mm == pytest.approx((2 * 15 * (7 / 15) * (8 / 15) / 28) ** 0.5)


def test_drift_and_movement_are_no_jitter() -> None:
    """Drift, and the error while the hand comes to rest, are not jitter; without a rest the figure is NaN."""
    times = np.arange(600) / RATE
    stops = moving(np.minimum(times, 5.0))
    late = moving(np.minimum(times - 0.1, 5.0))
    assert rests(np.arange(600), stops) == [(150, 600)]
    assert jitter(np.arange(600), times, late + times[:, None, None], stops).deviation_mm < 0.3
    assert jitter(np.arange(600), times, late, stops).deviation_mm == pytest.approx(0.0, abs=1e-9)
    assert np.isnan(jitter(NUMBERS, TIMES, moving(TIMES), moving(TIMES)).deviation_mm)
    assert jitter(NUMBERS[:1], TIMES[:1], moving(TIMES[:1]), moving(TIMES[:1])).frames == 0


def test_a_missing_frame_ends_a_rest() -> None:
    """A missing frame splits a rest, because the motion during it is unknown."""
    still = np.broadcast_to(BASE, (4, 31, 3))
    assert rests(np.array([0, 1, 3, 4]), still) == [(0, 2), (2, 4)]


def test_bones() -> None:
    """A bone's change is its largest distance from its median; the root has none."""
    parents = np.array([-1, 0, 1])
    tracked = np.zeros((5, 3, 3))
    tracked[:, 1, 0], tracked[:, 2, 0] = 30, 50
    tracked[3, 2, 0] = 53
    np.testing.assert_allclose(bone_changes(tracked + np.arange(5)[:, None, None], parents), [0, 0, 3])
