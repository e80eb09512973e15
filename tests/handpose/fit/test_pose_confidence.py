"""handpose/fit/pose_confidence.py"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from handpose.fit.pose_confidence import (
    FINGER_SIGNS,
    LOST_MM,
    PACKAGED,
    SIGNS,
    Evidence,
    Judge,
    Regressions,
    finger_errors,
    finger_signs,
    pose_signs,
    read_weights,
    unknown_finger_errors,
)
from handpose.fit.settings import FitSettings
from handpose.fit.support import JointDepths
from netlib.errors import PrototxtError
from tests.support.bad_input import bad_inputs

HAND, FINGER = read_weights()
JUDGE = Judge(FitSettings())
NONE = np.zeros(1)  # no lag
FINGERS = {
    "behind": np.zeros((1, 5)),
    "before": np.zeros((1, 5)),
    "lag": np.zeros((1, 5)),
    "seen": np.ones((1, 5)),
}
NO_FINGERS = dict.fromkeys(FINGERS, np.zeros((1, 0)))


def of(
    signs: float | np.ndarray,
    lag: np.ndarray = NONE,
    fingers: dict[str, np.ndarray] = NO_FINGERS,
    shown: float = 1.0,
) -> tuple[float, float]:
    """The expected error and the confidence of one pose."""
    all_signs = np.broadcast_to(signs, (1, len(SIGNS)))
    evidence = Evidence(all_signs, lag, np.array([shown]), *fingers.values())
    error_mm, confidence, _ = JUDGE.judged(evidence)
    return error_mm[0], confidence[0]


def test_worked_by_hand() -> None:
    """All signs 0: the mean of the logarithm is the constant. One sign of e - 1 adds its weight."""
    error, confidence = of(0.0)
    assert error == pytest.approx(np.exp(HAND.constant + HAND.spread**2 / 2))
    assert confidence == pytest.approx(1, abs=1e-5)
    for name, weight, signs in zip(
        SIGNS, HAND.weights, (np.e - 1) * np.eye(len(SIGNS)), strict=True
    ):
        fit = np.exp(HAND.constant + weight)
        expected = np.hypot(fit, np.e - 1) if name == "before" else fit
        assert of(signs)[0] == pytest.approx(expected * np.exp(HAND.spread**2 / 2))
    assert (HAND.weights >= 0).all() and (FINGER.weights >= 0).all()


def test_half_at_thirty_millimetres() -> None:
    """The confidence is 50% where the median error is 30 mm, for instance for a pose
    smoothed by that much.
    """
    lag = np.sqrt(30**2 - np.exp(2 * HAND.constant))
    error, confidence = of(0.0, lag=np.array([lag]))
    assert confidence == pytest.approx(0.5)
    assert error == pytest.approx(30 * np.exp(HAND.spread**2 / 2))


def test_confidence_falls_with_the_visible_share() -> None:
    """The less of the fingers was seen, the lower the confidence and the higher the expected
    error.
    """
    guessed = np.array([name == "guessed" for name in SIGNS])
    errors, confidences = zip(*(of(20.0 - (20.0 - share) * guessed) for share in (0, 0.2, 0.5, 1)))
    assert (np.diff(errors) > 0).all()
    assert (np.diff(confidences) < 0).all()


def test_of_little_that_is_seen_nothing_is_sure() -> None:
    least = JUDGE.settings.least_shown
    sure = of(1.0, shown=least)
    assert of(1.0) == sure and of(1.0, shown=least / 2)[1] == pytest.approx(sure[1] / 2)
    assert of(1.0, shown=0.0) == (30.0, 0.0)


def test_a_hand_whose_fingers_are_in_doubt() -> None:
    """The expected error is the geometric mean of the whole's and the fingers'; the confidence
    is the whole's.
    """
    whole, confidence = of(0.0)
    for behind in (0.0, 90.0):
        fingers = FINGERS | {"behind": behind * (np.arange(5) == 2)[None]}
        expected = np.sqrt(whole * errors_of(whole, fingers).mean())
        assert of(0.0, fingers=fingers) == pytest.approx((expected, confidence))


def test_no_expected_error_contradicts_the_confidence() -> None:
    """Fingers that seem right do not make the error of a pose that is probably wrong less than
    Markov's inequality.
    """
    sure = Regressions(HAND, FINGER._replace(constant=-3.0))
    lag = np.array([60.0])
    evidence = Evidence(np.zeros((1, len(SIGNS))), lag, np.ones(1), *FINGERS.values())
    judged = JUDGE.judged(evidence, sure)
    assert judged.confidence < 0.2 and judged.finger_error_mm.max() < 5
    assert judged.error_mm == pytest.approx(30 * (1 - judged.confidence))


def test_an_empty_crop() -> None:
    """Infinite signs, of a crop that shows nothing, give the largest error and no confidence."""
    error, confidence = of(pose_signs(np.full((1, 4), np.inf), JointDepths(NONE, NONE), NONE, NONE))
    assert error == LOST_MM and confidence < 0.01


def test_the_side_by_its_cost() -> None:
    """Equal costs tell nothing, the sides' probabilities add up to 1, and a single image never
    tells for certain.
    """

    def chance(cost: float, other: float) -> float:
        return JUDGE.side_chance(JUDGE.side_log_ratio(cost, other))

    assert chance(80, 80) == 0.5
    found, other = chance(80, 100), chance(100, 80)
    assert found == pytest.approx(1 / (1 + 0.8**8)) == 1 - other
    assert chance(80, 400) == chance(80, np.inf) < 0.99


def errors_of(whole: float, fingers: dict[str, np.ndarray]) -> np.ndarray:
    """The expected errors (1, 5) of the fingers of a hand with this error in mm as a whole."""
    signs = np.zeros((1, len(SIGNS)))
    return finger_errors(
        finger_signs(np.array([whole]), Evidence(signs, NONE, NONE, *fingers.values())), FINGER
    )


def test_finger_errors_worked_by_hand() -> None:
    """A seen finger of a hand with 1 mm has the constant; each sign adds its weight, of
    its finger alone.
    """
    constant = np.exp(FINGER.constant + FINGER.spread**2 / 2)
    whole, *weights = FINGER.weights
    assert_allclose(errors_of(1.0, FINGERS), [[constant] * 5])
    assert_allclose(errors_of(np.e, FINGERS), [[constant * np.exp(whole)] * 5])
    for sign, weight in zip(FINGERS, weights, strict=True):
        change = -1 if sign == "seen" else np.e - 1
        worse = FINGERS | {sign: FINGERS[sign] + change * (np.arange(5) == 2)}
        assert_allclose(errors_of(1.0, worse)[0], constant * np.exp([0, 0, weight, 0, 0]))


def test_finger_errors_are_bounded() -> None:
    """The largest error is that of a lost hand, and without knowledge it is NaN."""
    lost = FINGERS | {"behind": np.full((1, 5), 1e6)}
    assert errors_of(LOST_MM, lost) == pytest.approx(LOST_MM)
    assert np.isnan(unknown_finger_errors()).all() and unknown_finger_errors().shape == (5,)


def test_weights_belong_to_their_signs(tmp_path: Path) -> None:
    """Each name of a file gives its own number, in the order of the signs."""
    path = tmp_path / "w.prototxt"
    values = iter(range(1, 99))
    names = {"hand": SIGNS, "finger": FINGER_SIGNS}
    text = {
        part: " ".join(f"{name}: {next(values)}" for name in (*signs, "constant", "spread"))
        for part, signs in names.items()
    }
    path.write_text("\n".join(f"{part} {{ {fields} }}" for part, fields in text.items()))
    hand, finger = read_weights(path)
    assert (hand.weights.tolist(), hand.constant, hand.spread) == ([*range(1, 8)], 8, 9)
    assert (finger.weights.tolist(), finger.constant, finger.spread) == ([*range(10, 15)], 15, 16)


@bad_inputs(
    PrototxtError,
    {
        name: (change, f"...w.prototxt:{line}")
        for name, change, line in (
            (
                "missing",
                (r"  surface: \S+\n", ""),
                "2:6: error: missing required field 'surface' in hand",
            ),
            (
                "unknown",
                ("surface:", "surfaces:"),
                "3:3: error: unknown field 'surfaces' (did you mean 'surface'?)",
            ),
            (
                "spread",
                (r"spread: \S+", "spread: 0"),
                "11:3: error: spread: 0; expected a number above 0",
            ),
            (
                "nan",
                (r"whole: \S+", "whole: nan"),
                "14:3: error: whole: nan; expected a finite number",
            ),
        )
    },
)
def test_invalid_weights_are_rejected(
    tmp_path: Path, given: tuple[str, str], rejected: Any
) -> None:
    path = tmp_path / "w.prototxt"
    path.write_text(re.sub(*given, PACKAGED.read_text(), count=1))
    with rejected:
        read_weights(path)
