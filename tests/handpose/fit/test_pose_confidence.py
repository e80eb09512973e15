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


def unseen(seen: float, hidden: float = 0.0) -> np.ndarray:
    """What is not seen of one pose; the rest is outside the image."""
    return unseen_share(Support(*(np.array([share]) for share in (seen, hidden, 0.0, 0.0, 1 - seen - hidden))))


NONE = np.zeros(1)  # no lag
Fingers = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]  # behind, before, lag, seen
NO_FINGERS: Fingers = (np.zeros((1, 0)),) * 4


def of(signs: np.ndarray, lag: np.ndarray, rest: np.ndarray, fingers: Fingers = NO_FINGERS) -> tuple[float, float]:
    """The expected error and the confidence of one pose."""
    error_mm, confidence, _ = judged(Evidence(signs, lag, rest, *fingers))
    return error_mm[0], confidence[0]


def test_worked_by_hand() -> None:
    """All signs 0: the mean of the logarithm is the constant. One sign of e - 1 adds its weight."""
    error, confidence = of(np.zeros((1, len(SIGNS))), NONE, unseen(1))
    assert error == pytest.approx(np.exp(CONSTANT + SPREAD**2 / 2)) and confidence == pytest.approx(1)
    for name, weight in zip(SIGNS, WEIGHTS, strict=True):
        signs = np.zeros((1, len(SIGNS)))
        signs[0, SIGNS.index(name)] = np.e - 1
        fit = np.exp(CONSTANT + weight)
        expected = np.hypot(fit, np.e - 1) if name == "before" else fit
        assert of(signs, NONE, unseen(1))[0] == pytest.approx(expected * np.exp(SPREAD**2 / 2))
    assert (WEIGHTS >= 0).all()


def test_half_at_thirty_millimetres() -> None:
    """The confidence is 50% where the median error is 30 mm, for instance for a pose smoothed by that much."""
    lag = np.array([np.sqrt(30**2 - np.exp(2 * CONSTANT))])
    error, confidence = of(np.zeros((1, len(SIGNS))), lag, unseen(1))
    assert confidence == pytest.approx(0.5) and error == pytest.approx(30 * np.exp(SPREAD**2 / 2))


def test_less_in_sight() -> None:
    """The less was seen, the lower the confidence and the higher the expected error, most if it is covered."""
    signs = np.full((1, len(SIGNS)), 1.0)
    found = [
        of(signs, NONE, unseen(seen, hidden)) for seen, hidden in ((0.9, 0.1), (0.75, 0.0), (0.75, 0.2), (0.3, 0.6))
    ]
    errors, confidences = zip(*found)
    assert (np.diff(errors) > 0).all() and (np.diff(confidences) < 0).all() and confidences[-1] < 0.3


def test_a_hand_whose_fingers_are_in_doubt() -> None:
    """The expected error is the geometric mean of the whole's and the fingers'; the confidence is the whole's."""
    signs, seen = np.zeros((1, len(SIGNS))), np.ones((1, 5))
    none = np.zeros((1, 5))
    whole, confidence = of(signs, NONE, unseen(1))
    for behind in (none, np.array([[0.0, 0, 90, 0, 0]])):
        fingers = (behind, none, none, seen)
        expected = np.sqrt(whole * finger_errors(np.array([whole]), *fingers).mean())
        assert of(signs, NONE, unseen(1), fingers) == pytest.approx((expected, confidence))


def test_no_expected_error_contradicts_the_confidence() -> None:
    """Fingers that seem right do not make the error of a pose that is probably wrong less than Markov's inequality."""
    none, seen = np.zeros((1, 5)), np.ones((1, 5))
    error, confidence = of(np.full((1, len(SIGNS)), 30.0), NONE, unseen(0.5, 0.5), (none, none, none, seen))
    assert confidence < 0.1 and error >= 30 * (1 - confidence)


def test_an_empty_crop() -> None:
    """Infinite signs, of a crop that shows nothing, give the largest error and no confidence."""
    signs = pose_signs(np.full((1, 5), np.inf), JointDepths(NONE, NONE), NONE, NONE)
    error, confidence = of(signs, NONE, unseen(0))
    assert error == LOST_MM and confidence < 0.01


def test_the_side_by_its_cost() -> None:
    """Equal costs tell nothing, the sides' probabilities add up to 1, and a single image never tells for certain."""
    assert side_chance(side_evidence(80, 80)) == 0.5
    assert (
        side_chance(side_evidence(80, 100))
        == pytest.approx(1 / (1 + 0.8**8))
        == 1 - side_chance(side_evidence(100, 80))
    )
    assert side_chance(side_evidence(80, 400)) == side_chance(side_evidence(80, np.inf)) < 0.99


SEEN = {"behind": np.zeros((1, 5)), "before": np.zeros((1, 5)), "lag_mm": np.zeros((1, 5)), "seen": np.ones((1, 5))}


def test_finger_errors_worked_by_hand() -> None:
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


def test_finger_errors_are_bounded() -> None:
    """The largest error is that of a lost hand, and without knowledge it is NaN."""
    assert finger_errors(np.array([LOST_MM]), **SEEN | {"behind": np.full((1, 5), 1e6)}) == pytest.approx(LOST_MM)
    assert np.isnan(unknown_finger_errors()).all() and unknown_finger_errors().shape == (5,)
