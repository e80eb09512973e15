"""handpose/fit/pose_confidence.py"""

from __future__ import annotations

import numpy as np
import pytest

from handpose.fit.pose_confidence import (
    CONSTANT,
    FINGER_SPREAD,
    LOST_MM,
    SIGNS,
    SPREAD,
    WEIGHTS,
    Evidence,
    finger_errors,
    judged,
    pose_signs,
    side_chance,
    side_evidence,
    unknown_finger_errors,
    unseen_share,
)
from handpose.fit.support import JointDepths, Support

NONE = np.zeros(1)  # no lag
FINGERS = {"behind": np.zeros((1, 5)), "before": np.zeros((1, 5)), "lag_mm": np.zeros((1, 5)), "seen": np.ones((1, 5))}
NO_FINGERS = dict.fromkeys(FINGERS, np.zeros((1, 0)))


def of(
    signs: float | np.ndarray, seen: float = 1.0, hidden: float = 0.0, lag: np.ndarray = NONE,
    fingers: dict[str, np.ndarray] = NO_FINGERS,
) -> tuple[float, float]:
    """The expected error and the confidence of one pose; what is neither seen nor hidden is outside the image."""
    support = Support(*(np.array([share]) for share in (seen, hidden, 0.0, 0.0, 1 - seen - hidden)))
    all_signs = np.broadcast_to(signs, (1, len(SIGNS)))
    error_mm, confidence, _ = judged(Evidence(all_signs, lag, unseen_share(support), *fingers.values()))
    return error_mm[0], confidence[0]


def test_worked_by_hand() -> None:
    """All signs 0: the mean of the logarithm is the constant. One sign of e - 1 adds its weight."""
    error, confidence = of(0.0)
    assert error == pytest.approx(np.exp(CONSTANT + SPREAD**2 / 2)) and confidence == pytest.approx(1)
    for name, weight, signs in zip(SIGNS, WEIGHTS, (np.e - 1) * np.eye(len(SIGNS)), strict=True):
        fit = np.exp(CONSTANT + weight)
        expected = np.hypot(fit, np.e - 1) if name == "before" else fit
        assert of(signs)[0] == pytest.approx(expected * np.exp(SPREAD**2 / 2))
    assert (WEIGHTS >= 0).all()


def test_half_at_thirty_millimetres() -> None:
    """The confidence is 50% where the median error is 30 mm, for instance for a pose smoothed by that much."""
    error, confidence = of(0.0, lag=np.array([np.sqrt(30**2 - np.exp(2 * CONSTANT))]))
    assert confidence == pytest.approx(0.5) and error == pytest.approx(30 * np.exp(SPREAD**2 / 2))


def test_less_in_sight() -> None:
    """The less was seen, the lower the confidence and the higher the expected error, most if it is covered."""
    found = [of(1.0, seen, hidden) for seen, hidden in ((0.9, 0.1), (0.75, 0.0), (0.75, 0.2), (0.3, 0.6))]
    errors, confidences = zip(*found)
    assert (np.diff(errors) > 0).all() and (np.diff(confidences) < 0).all() and confidences[-1] < 0.3


def test_a_hand_whose_fingers_are_in_doubt() -> None:
    """The expected error is the geometric mean of the whole's and the fingers'; the confidence is the whole's."""
    whole, confidence = of(0.0)
    for behind in (0.0, 90.0):
        fingers = FINGERS | {"behind": behind * (np.arange(5) == 2)[None]}
        expected = np.sqrt(whole * finger_errors(np.array([whole]), **fingers).mean())
        assert of(0.0, fingers=fingers) == pytest.approx((expected, confidence))


def test_no_expected_error_contradicts_the_confidence() -> None:
    """Fingers that seem right do not make the error of a pose that is probably wrong less than Markov's inequality."""
    error, confidence = of(0.0, lag=np.array([60.0]), fingers=FINGERS)
    assert confidence < 0.1 and error == pytest.approx(30 * (1 - confidence))


def test_an_empty_crop() -> None:
    """Infinite signs, of a crop that shows nothing, give the largest error and no confidence."""
    error, confidence = of(pose_signs(np.full((1, 5), np.inf), JointDepths(NONE, NONE), NONE, NONE), 0.0)
    assert error == LOST_MM and confidence < 0.01


def test_the_side_by_its_cost() -> None:
    """Equal costs tell nothing, the sides' probabilities add up to 1, and a single image never tells for certain."""
    assert side_chance(side_evidence(80, 80)) == 0.5
    found, other = side_chance(side_evidence(80, 100)), side_chance(side_evidence(100, 80))
    assert found == pytest.approx(1 / (1 + 0.8**8)) == 1 - other
    assert side_chance(side_evidence(80, 400)) == side_chance(side_evidence(80, np.inf)) < 0.99


def test_finger_errors_worked_by_hand() -> None:
    """A seen finger of a hand with 1 mm has the constant; each sign adds its weight, of its finger alone."""
    hand, constant = np.ones(1), np.exp(0.715 + FINGER_SPREAD**2 / 2)
    np.testing.assert_allclose(finger_errors(hand, **FINGERS), [[constant] * 5])
    np.testing.assert_allclose(finger_errors(hand * np.e, **FINGERS), [[constant * np.exp(0.327)] * 5])
    weights = {"behind": 0.270, "before": 0.118, "lag_mm": 0.095, "seen": 0.291}
    for sign, weight in weights.items():
        change = -1 if sign == "seen" else np.e - 1
        worse = FINGERS | {sign: FINGERS[sign] + change * (np.arange(5) == 2)}
        np.testing.assert_allclose(finger_errors(hand, **worse)[0], constant * np.exp([0, 0, weight, 0, 0]))


def test_finger_errors_are_bounded() -> None:
    """The largest error is that of a lost hand, and without knowledge it is NaN."""
    lost = FINGERS | {"behind": np.full((1, 5), 1e6)}
    assert finger_errors(np.array([LOST_MM]), **lost) == pytest.approx(LOST_MM)
    assert np.isnan(unknown_finger_errors()).all() and unknown_finger_errors().shape == (5,)
