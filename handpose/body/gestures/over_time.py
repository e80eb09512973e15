"""The gesture of a hand over time, with smoothing and hysteresis.

Scores are smoothed with the time constant SMOOTH_S. A gesture begins when its smoothed score is above BEGIN, and lasts
until it is below END or another one begins. A hand that was missing for FORGET_S starts without history.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from handpose.body.gestures.shapes import GESTURES, NUMBERS, scores
from handpose.body.joint_formats.frames import HandFrames
from handpose.body.sides import Side
from layers.hand.skeleton import Skeleton
from netlib.blob import Array
from netlib.errors import DataError

SMOOTH_S = 0.08
BEGIN, END = 0.6, 0.35
FORGET_S = 0.4


class Gesture(NamedTuple):
    """A gesture: its name, "" for none, and its smoothed score (for none, one minus the others')."""

    name: str
    confidence: float

    @property
    def number(self) -> int | None:
        """The number that the fingers show, if any."""
        return NUMBERS.get(self.name)


class _State(NamedTuple):
    time: float
    scores: Array
    name: str


class GestureReader:
    """Reads the gestures of all hands of a track, frame by frame."""

    def __init__(self, skeleton: Skeleton) -> None:
        self._skeleton = skeleton
        self._states: dict[int, _State] = {}

    def read(self, id: int, hand: Side, xyz: Array, time: float, frames: HandFrames | None = None) -> Gesture:
        """The gesture of the hand ``id`` with joints (K, 3) in mm, at ``time`` s.

        Raises DataError for times of a hand that descend, and for joints that form no hand (``hand_frames``).
        frames  the hand's directions, if they are computed already
        """
        before = self._states.get(id)
        if not math.isfinite(time) or (before is not None and time < before.time):
            after = "" if before is None else f" after {before.time:g} s"
            raise DataError(f"hand {id} at {time:g} s{after}; expected finite times that do not descend")
        seen = np.array(list(scores(self._skeleton, hand, xyz, frames).values()))
        if before is None or time - before.time > FORGET_S:
            smooth, name = seen, ""
        else:
            part = 1 - math.exp(-(time - before.time) / SMOOTH_S)
            smooth, name = before.scores + part * (seen - before.scores), before.name
        best = int(smooth.argmax())
        if smooth[best] > BEGIN:
            name = GESTURES[best]
        elif name and smooth[GESTURES.index(name)] < END:
            name = ""
        self._states[id] = _State(time, smooth, name)
        return Gesture(name, float(smooth[GESTURES.index(name)] if name else max(0.0, 1 - smooth.sum())))
