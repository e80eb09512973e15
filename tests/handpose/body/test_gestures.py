"""handpose/body/gestures.py"""

from __future__ import annotations

import numpy as np
import pytest

from handpose.body import gestures
from handpose.body.gestures import (
    BEGIN,
    END,
    FINGER_COUNTS,
    FORGET_S,
    GESTURES,
    GestureReader,
    scores,
)
from handpose.synthetic import prior_file
from handpose.synthetic.pose_prior import BodySampler
from handpose.synthetic.prior_parameters import PoseParameter, PosePartParameter
from layers.hand.kinematics import Kinematics
from layers.hand.skeleton import load
from netlib.blob import Array

# A pose of each gesture. Unlike those of the prior files, about which training data are drawn, the
# thumb is out or across the palm as in the gesture's definition, and a pinch touches.
_OUT = {
    "thumb_pip_rot_y": 0.5,
    "thumb_pip_rot_z": 0.1,
    "thumb_dip_rot_z": 0.7,
    "thumb_tip_rot_z": 0.4,
}
_ACROSS = {
    "thumb_pip_rot_y": 0.3,
    "thumb_pip_rot_z": 0.75,
    "thumb_dip_rot_z": 0.8,
    "thumb_tip_rot_z": 0.3,
}
_FOLDED = {
    "thumb_pip_rot_y": 0.7,
    "thumb_pip_rot_z": 0.72,
    "thumb_dip_rot_z": 0.97,
    "thumb_tip_rot_z": 0.94,
}
_TOUCHING = {
    "thumb_pip_rot_y": 0.39,
    "thumb_pip_rot_z": 0.57,
    "thumb_dip_rot_z": 0.68,
    "thumb_tip_rot_z": 0.59,
    "index_base_rot_x": 0.58,
    "index_base_rot_z": 0.46,
    "index_pip_rot_x": 0.33,
    "index_dip_rot_x": 0.33,
}


def _pose(
    name: str, bends: tuple[float, float, float, float], at: dict[str, float]
) -> PoseParameter:
    """A pose: the bends of index to little finger with their knuckles, and DoFs as fractions
    of their ranges.
    """
    bent = []
    for finger, bend in zip(("index", "middle", "ring", "little"), bends):
        if bend >= 0:
            chains = finger, f"{finger}_knuckle"
            bent += [PosePartParameter(chain, bend) for chain in chains]
    placed = [PosePartParameter(of, part) for of, part in at.items()]
    return PoseParameter(name, tuple(bent), tuple(placed))


SHOWN = (
    _pose("open", (0.12, 0.12, 0.12, 0.12), _OUT),
    _pose("fist", (0.8, 0.8, 0.8, 0.8), _FOLDED),
    _pose("point", (0.1, 0.8, 0.8, 0.8), _FOLDED),
    _pose("pinch", (-1, 0.2, 0.15, 0.1), _TOUCHING),
    _pose("thumb_up", (0.8, 0.8, 0.8, 0.8), _OUT),
    _pose("two", (0.1, 0.1, 0.8, 0.8), _FOLDED),
    _pose("three", (0.1, 0.1, 0.1, 0.8), _FOLDED),
    _pose("four", (0.1, 0.1, 0.1, 0.1), _ACROSS),
)

SAMPLER = BodySampler(prior_file.load(prior_file.PEOPLE_PRIOR).but(pose=SHOWN))
SK = SAMPLER.skeleton


def joints(inputs: Array, unit_mm: float = 130.0) -> Array:
    """A right hand (K, 3) in mm."""
    return np.asarray(Kinematics(SK).joints(inputs[None])[0] * unit_mm)


@pytest.mark.parametrize("gesture", [pose.name for pose in SHOWN])
@pytest.mark.parametrize("unit_mm", [100.0, 160.0])
def test_each_gesture_is_its_own(gesture: str, unit_mm: float) -> None:
    """Shown poses are recognised for hands of any size and orientation, right and left."""
    inputs = SAMPLER.poses[gesture].copy()
    inputs[3:6] = (0.4, -1.1, 2.0)
    right = joints(inputs, unit_mm)
    for found in (scores(SK, "right", right), scores(SK, "left", right * [-1, 1, 1])):
        assert max(found, key=lambda name: found[name]) == gesture
        assert found[gesture] > 0.7 and sum(found.values()) <= 1 + 1e-9


def test_a_half_bent_hand_shows_none() -> None:
    """Fingers between straight and bent give no gesture a high score."""
    found = scores(SK, "right", joints((SAMPLER.poses["open"] + SAMPLER.poses["fist"]) / 2))
    assert max(found.values()) < 0.5


def test_numbers() -> None:
    assert set(FINGER_COUNTS) < set(GESTURES)
    assert sorted(FINGER_COUNTS.values()) == [0, 1, 2, 3, 4, 5]


RATE = 30.0


def read(
    monkeypatch: pytest.MonkeyPatch,
    *seen: dict[str, float],
    ids: list[int] | None = None,
    times: list[float] | None = None,
) -> list[str]:
    """The gestures read from one hand's frames with these scores, at 30 frames per second."""
    frames = iter(seen)
    monkeypatch.setattr(gestures, "scores", lambda *_: dict.fromkeys(GESTURES, 0.0) | next(frames))
    reader, hand = GestureReader(load()), np.zeros((31, 3))
    times = times or [i / RATE for i in range(len(seen))]
    ids = ids or [0] * len(seen)
    return [reader.read(id, "right", hand, time).name for id, time in zip(ids, times)]


OPEN, FIST, TWO = {"open": 1.0}, {"fist": 1.0}, {"two": 1.0}
DOUBTFUL = {"two": (BEGIN + END) / 2}


@pytest.mark.parametrize(
    ("seen", "found"),
    [
        ([*[OPEN] * 5, FIST, OPEN, {}, OPEN], ["open"] * 9),
        ([*[OPEN] * 5, *[FIST] * 8], [*["open"] * 7, *["fist"] * 6]),
        ([DOUBTFUL] * 20, [""] * 20),
        ([TWO, *[DOUBTFUL] * 20], ["two"] * 21),
        ([TWO, *[{"two": END - 0.1}] * 20], [*["two"] * 5, *[""] * 16]),
    ],
    ids=[
        "one frame changes nothing",
        "one that lasts is read",
        "doubtful from the start",
        "doubtful later",
        "gone",
    ],
)
def test_gestures_have_hysteresis(
    monkeypatch: pytest.MonkeyPatch, seen: list[dict[str, float]], found: list[str]
) -> None:
    """A gesture begins above a threshold and lasts until it is below another one, both smoothed."""
    assert read(monkeypatch, *seen) == found


def test_hands_are_apart(monkeypatch: pytest.MonkeyPatch) -> None:
    times = [i // 2 / RATE for i in range(8)]
    found = read(monkeypatch, *[OPEN, FIST] * 4, ids=[0, 1] * 4, times=times)
    assert found == ["open", "fist"] * 4


def test_a_gesture_is_forgotten_while_the_hand_is_away(monkeypatch: pytest.MonkeyPatch) -> None:
    away = FORGET_S + 0.1
    assert read(monkeypatch, {"open": 1.0}, {"two": 0.5}, times=[0.0, away]) == ["open", ""]


def test_confidence(monkeypatch: pytest.MonkeyPatch) -> None:
    """The confidence is the gesture's score, or without a gesture what the scores leave of 1."""
    frames = iter([{"open": 0.9}, {"open": 0.2, "fist": 0.3}])
    monkeypatch.setattr(gestures, "scores", lambda *_: dict.fromkeys(GESTURES, 0.0) | next(frames))
    for name, confidence in (("open", 0.9), ("", 0.5)):
        found = GestureReader(load()).read(0, "right", np.zeros((31, 3)), 0.0)
        assert found.name == name and found.confidence == pytest.approx(confidence)
