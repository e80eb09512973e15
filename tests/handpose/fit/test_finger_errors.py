"""handpose/fit/pose_confidence.py: finger_errors"""

from __future__ import annotations

import numpy as np
import pytest

from handpose.fit.network_errors import LOST_MM
from handpose.fit.pose_confidence import FINGER_SPREAD, finger_errors, unknown_finger_errors

SEEN = {"behind": np.zeros((1, 5)), "before": np.zeros((1, 5)), "lag_mm": np.zeros((1, 5)), "seen": np.ones((1, 5))}


def test_worked_by_hand() -> None:
    """A seen finger of a hand with 1 mm has the constant; each sign adds its weight, of its finger alone."""
    hand = np.ones(1)
    constant = np.exp(0.715 + FINGER_SPREAD**2 / 2)
    np.testing.assert_allclose(finger_errors(hand, **SEEN), [[constant] * 5])
    np.testing.assert_allclose(finger_errors(hand * np.e, **SEEN), [[constant * np.exp(0.327)] * 5])
    weights = {
        "behind": (np.e - 1, 0.270),
        "before": (np.e - 1, 0.118),
        "lag_mm": (np.e - 1, 0.095),
        "seen": (-1, 0.291),
    }
    for sign, (change, weight) in weights.items():
        worse = finger_errors(hand, **SEEN | {sign: SEEN[sign] + change * (np.arange(5) == 2)})
        np.testing.assert_allclose(worse[0], constant * np.exp([0, 0, weight, 0, 0]))


def test_bounded() -> None:
    """The largest error is that of a lost hand, and without knowledge it is NaN."""
    assert finger_errors(np.array([LOST_MM]), **SEEN | {"behind": np.full((1, 5), 1e6)}) == pytest.approx(LOST_MM)
    assert np.isnan(unknown_finger_errors()).all() and unknown_finger_errors().shape == (5,)
