"""The gesture of a hand: open, fist, point, pinch, thumb up, two, three, four; its score in one
frame, and over time.

Four fingers are straight or bent, the thumb is out or across the palm, thumb and index finger touch
or not. Each of these is a probability, a logistic function of one measure of the hand; a gesture is
the product of those it requires:

    finger straight   the sum of the bends at its three joints, about STRAIGHT
    thumb out         distance of its tip from the middle knuckle, about OUT palms
    touch             distance of the tips of thumb and index finger, about TOUCH palms

A palm is the distance of the wrist from the middle knuckle. Gestures exclude each other, so the
scores sum to 1 at most; the rest is no gesture. "open" is the number five, "point" the number one,
with the thumb anywhere; "two" is index and middle finger, "three" the ring finger, too.

Over time, scores are smoothed with the time constant SMOOTH_S. A gesture begins when its smoothed
score is above BEGIN, and lasts until it is below END or another one begins. A hand that was missing
for FORGET_S starts without history.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from handpose.body.joint_formats.angles import MIN_PALM_MM, anatomical_angles
from handpose.body.joint_formats.frames import LONG_FINGERS
from handpose.body.sides import Side
from layers.hand.skeleton import Skeleton
from netlib.blob import Array
from netlib.errors import DataError

STRAIGHT = (100.0, 14.0)  # degrees: where the probability is one half, and the scale of its slope
# palms; on the seeds of the choice (docs/gestures.md) at most 0.76 across, at least 0.87 out
OUT = (0.81, 0.04)
TOUCH = (0.32, 0.03)
# Straight fingers: index, middle, ring, little; and whether the thumb is out (None: either).
STRAIGHT_FINGERS: dict[str, tuple[tuple[bool, bool, bool, bool], bool | None]] = {
    "open": ((True, True, True, True), True),
    "fist": ((False, False, False, False), False),
    "point": ((True, False, False, False), None),
    "thumb_up": ((False, False, False, False), True),
    "two": ((True, True, False, False), None),
    "three": ((True, True, True, False), None),
    "four": ((True, True, True, True), False),
}
PINCH = "pinch"  # thumb and index finger touch, the middle finger is straight
GESTURES = (*STRAIGHT_FINGERS, PINCH)
FINGER_COUNTS = {"fist": 0, "point": 1, "two": 2, "three": 3, "four": 4, "open": 5}


def scores(
    skeleton: Skeleton, hand: Side, xyz: Array, angles: Mapping[str, float] | None = None
) -> dict[str, float]:
    """The score of each gesture for joints (K, 3) in mm, camera axes.

    angles  their ``anatomical_angles``, if they are known

    Raises DataError, see ``anatomical_angles``.
    """
    angles = angles or anatomical_angles(skeleton, hand, xyz)
    at = dict(zip(skeleton.joint_names, np.asarray(xyz, np.float64)))
    bends = [
        sum(angles[f"{finger}_{joint}_flexion"] for joint in ("mcp", "pip", "dip"))
        for finger in LONG_FINGERS
    ]
    straight = [1 - _over(bend, STRAIGHT) for bend in bends]
    palm = _distance(at["middle_mcp"], (at["wrist_left"] + at["wrist_middle"]) / 2)
    if not palm > MIN_PALM_MM:
        raise DataError("the wrist is at the middle knuckle; expected a palm")
    out = _over(_distance(at["thumb_tip"], at["middle_mcp"]) / palm, OUT)
    touch = 1 - _over(_distance(at["thumb_tip"], at["index_tip"]) / palm, TOUCH)
    found = {PINCH: touch * straight[1]}
    by_thumb = {True: out, False: 1 - out, None: 1.0}
    for name, (wanted, thumb) in STRAIGHT_FINGERS.items():
        fingers = np.prod(
            [part if is_straight else 1 - part for part, is_straight in zip(straight, wanted)]
        )
        found[name] = float(fingers * by_thumb[thumb] * (1 - found[PINCH]))
    return {name: found[name] for name in GESTURES}


def _over(value: float, threshold: tuple[float, float]) -> float:
    """The probability that a measure is above its threshold."""
    middle, slope = threshold
    return float(1 / (1 + np.exp(-(value - middle) / slope)))


def _distance(a: Array, b: Array) -> float:
    return float(np.linalg.norm(a - b))


SMOOTH_S = 0.08
BEGIN, END = 0.6, 0.35
FORGET_S = 0.4


class Gesture(NamedTuple):
    """A gesture: its name, "" for none, and its smoothed score
    (for none, one minus the others').
    """

    name: str
    confidence: float

    @property
    def number(self) -> int | None:
        """The number that the fingers show, if any."""
        return FINGER_COUNTS.get(self.name)


class _State(NamedTuple):
    time: float
    scores: Array
    name: str


class GestureReader:
    """Reads the gestures of all hands of a track, frame by frame."""

    def __init__(self, skeleton: Skeleton) -> None:
        self._skeleton = skeleton
        self._states: dict[int, _State] = {}

    def read(
        self,
        id: int,
        hand: Side,
        xyz: Array,
        time: float,
        angles: Mapping[str, float] | None = None,
    ) -> Gesture:
        """The gesture of the hand ``id`` with joints (K, 3) in mm, at ``time`` s.

        angles  as for ``scores``

        Raises DataError for times of a hand that descend, and for joints that form no hand
        (``anatomical_angles``).
        """
        before = self._states.get(id)
        if not math.isfinite(time) or (before is not None and time < before.time):
            after = "" if before is None else f" after {before.time:g} s"
            raise DataError(
                f"hand {id} at {time:g} s{after}; expected finite times that do not descend"
            )
        seen = np.array(list(scores(self._skeleton, hand, xyz, angles).values()))
        if before is None or time - before.time > FORGET_S:
            smooth = seen
            name = ""
        else:
            part = 1 - math.exp(-(time - before.time) / SMOOTH_S)
            smooth = before.scores + part * (seen - before.scores)
            name = before.name
        best = int(smooth.argmax())
        if smooth[best] > BEGIN:
            name = GESTURES[best]
        elif name and smooth[GESTURES.index(name)] < END:
            name = ""
        self._states[id] = _State(time, smooth, name)
        return Gesture(
            name, float(smooth[GESTURES.index(name)] if name else max(0.0, 1 - smooth.sum()))
        )
