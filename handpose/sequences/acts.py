"""The acts of a hand in a synthetic recording, and the movements they consist of."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.spatial.transform import Rotation

from handpose.body.sides import Side
from handpose.sequences.choices import Choices
from handpose.sequences.gestures import fingers_of
from handpose.sequences.movements import OVERLAP, TOP_SPEED, Movement, Strokes
from handpose.sequences.person import Person
from handpose.sequences.surroundings import Volume
from handpose.synthetic.pose_prior import BodySampler
from netlib.blob import Array

Kind = Literal["rest", "gestures", "wave", "moving", "away"]

FINGER_SPEED, PALM_SPEED, HAND_SPEED = 6.0, 4.0, 1000.0  # maximum speeds: rad/s, rad/s, mm/s
STROKE = (0.5, 1.5)  # s: duration of a stroke; longer if it would be too fast
BOUT, HOLD = (3.0, 5.0), (1.1, 1.6)  # s: durations of movement and of the rest after it
WAVE = np.deg2rad(25)  # maximum turn of a palm to either side
FACING = 0.35  # factor of the prior's pitch and yaw while gestures are shown
SWAY_MM = 25.0  # deviation of a hand's place while it shows gestures


@dataclass(frozen=True)
class Act:
    """One act and its duration in s, above 0.

    rest      keep still
    gestures  show gestures in random order, each for a while, with a slightly swaying position: those of ``of``, or all
    wave      with an open hand
    moving    fingers, palm and position at once, in bouts with rests
    away      leave the image and return at the end; as the first act, enter
    """

    kind: Kind
    seconds: float
    of: tuple[str, ...] = ()


class Actor:
    """Makes the movement of one hand from acts.

    volume   where it moves
    outward  -1 or 1: the side, along x, on which its elbow stays; 0 for none
    """

    def __init__(
        self, rng: np.random.Generator, sampler: BodySampler, person: Person, side: Side, volume: Volume, outward: float
    ) -> None:
        self.rng, self.sampler, self.person, self.volume = rng, sampler, person, volume
        self.choices = Choices(rng, sampler, person, side, outward)
        self.time = 0.0
        fingers = fingers_of("relaxed", person, sampler)
        palm, arm = self.choices.palm(None, FACING)
        self.movement = Movement(sampler, person, side, fingers, palm, arm, volume.place(rng))

    def act(self, acts: Sequence[Act], seconds: float) -> Movement:
        """Perform the acts in a loop until the given time in s is over, which does not change the movement.

        An act that begins while a hand still returns is performed, too.
        """
        n = 0
        while min(self.time, _begin(self.movement.place.strokes, self.time, np.inf)) < seconds:
            act = acts[n % len(acts)]
            end = self.time + act.seconds
            if act.kind == "away":
                self._away(end, first=n == 0)
            elif act.kind == "gestures":
                self._gestures(act.of, end)
            else:
                {"wave": self._wave, "moving": self._moving}.get(act.kind, _still)(end)
            self.time = end
            n += 1
        return self.movement

    # ------------------------------------------------------------------------------------------ acts

    def _gestures(self, of: tuple[str, ...], end: float) -> None:
        names: list[str] = []
        self._turn(*self.choices.palm(self.movement.palm.keys[-1], FACING), self.rng.uniform(*STROKE), end)
        middle = self.movement.place.keys[-1]
        while self.time < end:
            names = names or [str(name) for name in self.rng.permutation(list(of or self.sampler.poses))]
            began = self.time
            if not self._show(fingers_of(names.pop(), self.person, self.sampler), end):
                return
            sway = middle + SWAY_MM * self.rng.standard_normal(3)
            self._go(self.volume.kept(sway), began, end)
            self.time += self.rng.uniform(0.4, 1.2)

    def _wave(self, end: float) -> None:
        palm, began = self.movement.palm, self.time
        self._show(fingers_of("five", self.person, self.sampler), end)
        middle, side = palm.keys[-1], 1.0
        self.time = began
        while self._turn(Rotation.from_rotvec([0, 0, side * WAVE]) * middle, self.movement.arm.keys[-1], 0.35, end):
            side = -side

    def _moving(self, end: float) -> None:
        """Fingers, palm and position have movements at different times."""
        while self.time < end:
            began, bout = self.time, min(self.time + self.rng.uniform(*BOUT), end)
            while self._show(self.choices.fingers(self.movement.fingers.keys[-1]), bout):
                pass
            self.time = began
            while self._turn(*self.choices.palm(self.movement.palm.keys[-1]), self.rng.uniform(*STROKE), bout):
                pass
            self.time = began
            while self._go(self.volume.place(self.rng), self.time, bout):
                pass
            self.time = bout + self.rng.uniform(*HOLD)

    def _away(self, end: float, first: bool) -> None:
        place = self.movement.place
        inside = place.keys[-1]
        outside = self.volume.outside(inside)
        if first:
            place.keys[-1] = outside
        else:
            self._go(outside, self.time, np.inf)
        lasts = TOP_SPEED * float(np.linalg.norm(outside - inside)) / HAND_SPEED
        place.move(max(end - lasts, place.strokes.end), lasts, inside)

    # ------------------------------------------------------------------------------------------ strokes

    def _show(self, fingers: Array, end: float) -> bool:
        """Move the fingers, through the open hand if they would collide; False if ``end`` is too early."""
        values = self.movement.fingers
        ways = [fingers]
        if self.choices.depth_between(values.keys[-1], fingers[None])[0] > self.sampler.prior.penetration:
            ways.insert(0, fingers_of("open", self.person, self.sampler))
        for way in ways:
            angle = float(np.abs(way - values.keys[-1]).max())
            lasts = max(self.rng.uniform(*STROKE), TOP_SPEED * angle / FINGER_SPEED)
            begin = _begin(values.strokes, self.time, lasts)
            if begin + lasts > end:
                return False
            values.move(begin, lasts, way)
            self.time = begin + lasts
        return True

    def _turn(self, palm: Rotation, arm: Array, lasts: float, end: float) -> bool:
        """Turn the palm and the forearm."""
        turns = self.movement.palm
        angle = (turns.keys[-1].inv() * palm).magnitude() + float(np.abs(arm - self.movement.arm.keys[-1]).max())
        lasts = max(lasts, TOP_SPEED * angle / PALM_SPEED)
        begin = _begin(turns.strokes, self.time, lasts)
        if begin + lasts > end:
            return False
        turns.move(begin, lasts, palm)
        self.movement.arm.move(begin, lasts, arm)
        self.time = begin + lasts
        return True

    def _go(self, to: Array, time: float, end: float) -> bool:
        """Move the hand to a position."""
        place = self.movement.place
        distance = float(np.linalg.norm(to - place.keys[-1]))
        lasts = max(self.rng.uniform(*STROKE), TOP_SPEED * distance / HAND_SPEED)
        begin = _begin(place.strokes, time, lasts)
        if begin + lasts > end:
            return False
        place.move(begin, lasts, to)
        self.time = max(self.time, begin + lasts)
        return True


def _still(end: float) -> None:
    """Keep still."""


def _begin(strokes: Strokes, time: float, lasts: float) -> float:
    """The start of a stroke requested at a time: a successor starts somewhat before the last one ends."""
    if not strokes.begins or strokes.end < time:
        return time
    return strokes.end - OVERLAP * min(lasts, strokes.lasts[-1])
