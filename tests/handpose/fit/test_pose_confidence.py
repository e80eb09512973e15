"""handpose/fit/pose_confidence.py"""

from __future__ import annotations

import numpy as np
import pytest

from handpose.fit.network_errors import LOST_MM
from handpose.fit.pose_confidence import (
    CONSTANT,
    SIGNS,
    SPREAD,
    WEIGHTS,
    judged,
    pose_signs,
    side_chance,
    side_evidence,
)
from handpose.fit.support import JointDepths, Support


def support(seen: float, hidden: float = 0.0) -> Support:
    """A support of one pose; the rest is outside the image."""
    return Support(*(np.array([share]) for share in (seen, hidden, 0.0, 0.0, 1 - seen - hidden)))


NONE = np.zeros(1)  # no lag


def test_worked_by_hand() -> None:
    """All signs 0: the mean of the logarithm is the constant. One sign of e - 1 adds its weight."""
    error, confidence = judged(np.zeros((1, len(SIGNS))), NONE, support(1))
    assert error[0] == pytest.approx(np.exp(CONSTANT + SPREAD**2 / 2)) and confidence[0] == pytest.approx(1)
    for name, weight in zip(SIGNS, WEIGHTS, strict=True):
        signs = np.zeros((1, len(SIGNS)))
        signs[0, SIGNS.index(name)] = np.e - 1
        fit = np.exp(CONSTANT + weight)
        expected = np.hypot(fit, np.e - 1) if name == "before" else fit
        assert judged(signs, NONE, support(1))[0] == pytest.approx(expected * np.exp(SPREAD**2 / 2))
    assert (WEIGHTS >= 0).all()


def test_half_at_thirty_millimetres() -> None:
    """The confidence is 50% where the median error is 30 mm, for instance for a pose smoothed by that much."""
    lag = np.array([np.sqrt(30**2 - np.exp(2 * CONSTANT))])
    error, confidence = judged(np.zeros((1, len(SIGNS))), lag, support(1))
    assert confidence[0] == pytest.approx(0.5) and error[0] == pytest.approx(30 * np.exp(SPREAD**2 / 2))


def test_less_in_sight() -> None:
    """The less was seen, the lower the confidence and the higher the expected error, most if it is covered."""
    signs = np.full((1, len(SIGNS)), 1.0)
    found = [
        judged(signs, NONE, support(seen, hidden))
        for seen, hidden in ((0.9, 0.1), (0.75, 0.0), (0.75, 0.2), (0.3, 0.6))
    ]
    errors, confidences = (np.ravel(values) for values in zip(*found))
    assert (np.diff(errors) > 0).all() and (np.diff(confidences) < 0).all() and confidences[-1] < 0.3


def test_an_empty_crop() -> None:
    """Infinite signs, of a crop that shows nothing, give the largest error and no confidence."""
    signs = pose_signs(np.full((1, 5), np.inf), JointDepths(NONE, NONE), NONE, NONE)
    error, confidence = judged(signs, NONE, support(0))
    assert error[0] == LOST_MM and confidence[0] < 0.01


def test_the_side_by_its_cost() -> None:
    """Equal costs tell nothing, the sides' probabilities add up to 1, and a single image never tells for certain."""
    assert side_chance(side_evidence(80, 80)) == 0.5
    assert (
        side_chance(side_evidence(80, 100))
        == pytest.approx(1 / (1 + 0.8**8))
        == 1 - side_chance(side_evidence(100, 80))
    )
    assert side_chance(side_evidence(80, 400)) == side_chance(side_evidence(80, np.inf)) < 0.99
