"""What a hand does: acts, one after the other, as strokes of a movement."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from handpose.facts.cameras import Camera
from handpose.synthetic.gestures import GESTURES, fingers_of
from handpose.synthetic.movements import OVERLAP, TOP_SPEED, Movement, Strokes, posed
from handpose.synthetic.person import Person
from handpose.synthetic.pose_prior import HandSampler
from handpose.tracks.track import MIRROR
from netlib.blob import Array

Kind = Literal["rest", "gestures", "wave", "moving", "away"]

FINGER_SPEED, PALM_SPEED, HAND_SPEED = 6.0, 4.0, 1000.0  # rad/s, rad/s, mm/s that nothing exceeds
STROKE = (0.5, 1.5)  # s that a stroke lasts, longer where it would be too fast
BOUT, HOLD = (3.0, 5.0), (1.1, 1.6)  # s that a hand moves, and keeps still after it
MARGIN_MM = 155.0  # from the middle of a crop to the border of where a hand moves
GONE_MM = 330.0  # from the border of the image to the middle of a hand that is away
MOST_TURN = np.deg2rad(80)  # of a palm in one stroke
WAVE = np.deg2rad(25)  # of a palm to either side
FACING = 0.35  # of the prior's pitch and yaw, where a hand is shown
SWAY_MM = 25.0  # deviation of a hand's place while it shows gestures
ARM_DEVIATION = 0.6  # of the skeleton file's, which are for any hand
TOWARDS, UPWARDS, INWARDS = 0.35, 0.2, 0.5  # the most of a forearm's direction to the camera, up, and to the other hand
CANDIDATES = 24  # of which the first that is possible is taken, or the best


@dataclass(frozen=True)
class Act:
    """One thing to do.

    rest      keep still
    gestures  show them in any order, each for a while, the place swaying a little
    wave      with an open hand
    moving    fingers, palm and place at once, in bouts, with a rest after each
    away      leave the image and come back at the end; as the first act, come; the last one ends away
    """

    kind: Kind
    seconds: float


class Volume(NamedTuple):
    """Where a hand moves: a part of the image, and depths in mm."""

    camera: Camera
    left: float = 0.0  # 0 to 1 of the image's width
    right: float = 1.0
    near: float = 450.0
    far: float = 850.0

    def roomy(self) -> Volume:
        """The same, no nearer than a hand and its way fit in."""
        c = self.camera
        needed = 1.15 * 2 * MARGIN_MM * max(c.fx / ((self.right - self.left) * c.width), c.fy / c.height)
        return self._replace(near=max(self.near, needed), far=max(self.far, 1.4 * needed))

    def place(self, rng: np.random.Generator) -> Array:
        """A place (3,) for the middle of a hand, in mm."""
        c, z = self.camera, rng.uniform(self.near, self.far)
        across, down = MARGIN_MM * c.fx / z, MARGIN_MM * c.fy / z
        u = rng.uniform(self.left * c.width + across, self.right * c.width - across)
        return c.unproject((u, rng.uniform(down, c.height - down), z))

    def kept(self, place: Array) -> Array:
        """The place (3,) within the volume that is nearest to another, about."""
        c, z = self.camera, float(np.clip(place[2], self.near, self.far))
        across, down = MARGIN_MM * c.fx / z, MARGIN_MM * c.fy / z
        u, v, _ = c.project([place[0], place[1], z])
        u = np.clip(u, self.left * c.width + across, self.right * c.width - across)
        return c.unproject((u, np.clip(v, down, c.height - down), z))

    def outside(self, place: Array) -> Array:
        """The place (3,) outside the image beside another, at the nearer side."""
        c, z = self.camera, place[2]
        u, v, _ = c.project(place)
        beside = GONE_MM * c.fx / z
        return c.unproject((-beside if u < (c.width - 1) / 2 else c.width + beside, v, z))


class Actor:
    """Makes the movement of one hand from acts.

    volume   where it moves
    outward  -1 or 1: the side, along x, on which its elbow stays; 0 for none
    """

    def __init__(
        self, rng: np.random.Generator, sampler: HandSampler, person: Person, side: str, volume: Volume, outward: float
    ) -> None:  # fmt: skip
        self.rng, self.sampler, self.person, self.volume = rng, sampler, person, volume
        self.side, self.outward = side, outward
        self.time = 0.0
        fingers = fingers_of("relaxed", person, sampler)
        palm, arm = self._palm(None, FACING)
        self.movement = Movement(sampler, person, side, fingers, palm, arm, volume.place(rng))

    def act(self, acts: Sequence[Act], seconds: float) -> Movement:
        """Do the acts, again and again, until so many seconds are over."""
        n = 0
        while self.time < seconds:
            act = acts[n % len(acts)]
            end = self.time + act.seconds
            if act.kind == "away":
                self._away(end, first=n == 0, last=end >= seconds)
            else:
                {"gestures": self._gestures, "wave": self._wave, "moving": self._moving}.get(act.kind, _still)(end)
            self.time = end
            n += 1
        return self.movement

    # ------------------------------------------------------------------------------------------ acts

    def _gestures(self, end: float) -> None:
        names: list[str] = []
        self._turn(*self._palm(self.movement.palm.keys[-1], FACING), self.rng.uniform(*STROKE), end)
        middle = self.movement.place.keys[-1]
        while self.time < end:
            names = names or [str(name) for name in self.rng.permutation(list(GESTURES))]
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
        """Fingers, palm and place have strokes of their own times."""
        while self.time < end:
            began, bout = self.time, min(self.time + self.rng.uniform(*BOUT), end)
            while self._show(self._fingers(), bout):
                pass
            self.time = began
            while self._turn(*self._palm(self.movement.palm.keys[-1]), self.rng.uniform(*STROKE), bout):
                pass
            self.time = began
            while self._go(self.volume.place(self.rng), self.time, bout):
                pass
            self.time = bout + self.rng.uniform(*HOLD)

    def _away(self, end: float, first: bool, last: bool) -> None:
        place = self.movement.place
        inside = place.keys[-1]
        outside = self.volume.outside(inside)
        if first:
            place.keys[-1] = outside
        else:
            self._go(outside, self.time, np.inf)
        if not last:
            lasts = TOP_SPEED * float(np.linalg.norm(outside - inside)) / HAND_SPEED
            place.move(max(end - lasts, place.strokes.end), lasts, inside)

    # ------------------------------------------------------------------------------------------ strokes

    def _show(self, fingers: Array, end: float) -> bool:
        """Fingers move, over the open hand if they would run through each other; False if ``end`` is too early."""
        values = self.movement.fingers
        ways = [fingers]
        if self._depth_between(values.keys[-1], fingers[None])[0] > self.sampler.prior.penetration:
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
        """The palm turns, and the forearm with it."""
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
        """The hand goes to a place."""
        place = self.movement.place
        distance = float(np.linalg.norm(to - place.keys[-1]))
        lasts = max(self.rng.uniform(*STROKE), TOP_SPEED * distance / HAND_SPEED)
        begin = _begin(place.strokes, time, lasts)
        if begin + lasts > end:
            return False
        place.move(begin, lasts, to)
        self.time = max(self.time, begin + lasts)
        return True

    # ------------------------------------------------------------------------------------------ poses

    def _fingers(self) -> Array:
        """Fingers as the prior has them, which can be reached from those before."""
        drawn = self.sampler.hands(self.rng, CANDIDATES).inputs
        drawn[:, [*self.sampler.rotation, *self.sampler.translation]] = 0
        depth = self._depth_between(self.movement.fingers.keys[-1], drawn)
        return np.asarray(drawn[_first(depth, self.sampler.prior.penetration)])

    def _depth_between(self, before: Array, after: Array) -> Array:
        """How deep (N,) mm fingers get into each other on the way from one pose (D,) to others (N, D)."""
        way = before + np.linspace(0, 1, 6)[1:, None, None] * (after - before)
        whole = np.zeros((way[..., 0].size, len(self.person.flesh.whole.initial)))
        whole[:, : way.shape[-1]] = way.reshape(len(whole), -1)
        return np.asarray(self.person.penetration_mm(whole).reshape(len(way), -1).max(axis=0))

    def _palm(self, before: Rotation | None, facing: float = 1.0) -> tuple[Rotation, Array]:
        """A palm and a forearm, as the prior has them, such that the arm may be a person's before the camera.

        facing  factor of pitch and yaw
        """
        sampler, flesh = self.sampler, self.sampler.flesh
        own = len(sampler.skeleton.initial)
        drawn = sampler.hands(self.rng, CANDIDATES).inputs
        angles = drawn[:, sampler.rotation] + sampler.skeleton.initial[sampler.rotation]
        palms = Rotation.from_euler("ZXY", angles * (1, facing, -facing))
        free = own + np.flatnonzero(~flesh.whole.fixed[own:])
        arms = np.zeros((CANDIDATES, len(flesh.whole.initial)))
        arms[:, free] = ARM_DEVIATION * flesh.deviation[free] * self.rng.standard_normal((CANDIDATES, len(free)))
        arms = np.clip(arms, flesh.whole.lower, flesh.whole.upper)[:, own:]
        strain = np.array([self._strain(before, palm, arm) for palm, arm in zip(palms, arms)])
        chosen = _first(strain, 0.0)
        return palms[chosen], arms[chosen]

    def _strain(self, before: Rotation | None, palm: Rotation, arm: Array) -> float:
        """How far a palm and a forearm are from what a person would do, 0 for not at all."""
        flesh = self.sampler.flesh
        step = np.zeros(3) if before is None else (before.inv() * palm).as_rotvec()
        parts = (1.0,) if before is None else (0.5, 1.0)
        ways = [palm * Rotation.from_rotvec(-(1 - part) * step) for part in parts]
        none = np.zeros(len(self.sampler.skeleton.initial))
        ends = self.person.ends(np.stack([posed(self.sampler, self.person, none, way, arm) for way in ways]))
        limb = (ends[:, flesh.end[flesh.limbs]] - ends[:, flesh.start[flesh.limbs]])[:, 0]
        limb = limb / np.linalg.norm(limb, axis=1, keepdims=True) * (MIRROR if self.side == "left" else 1.0)
        inwards = -limb[:, 0] * self.outward
        over = np.stack([-limb[:, 2] - TOWARDS, limb[:, 1] - UPWARDS, inwards - INWARDS])
        return float(np.maximum(over, 0).sum() + max(np.linalg.norm(step) - MOST_TURN, 0))


def _still(end: float) -> None:
    """Nothing moves."""


def _begin(strokes: Strokes, time: float, lasts: float) -> float:
    """When a stroke begins that could begin at a time: somewhat before the last one ends, if it follows it."""
    if not strokes.begins or strokes.end < time:
        return time
    return strokes.end - OVERLAP * min(lasts, strokes.lasts[-1])


def _first(found: Array, most: float) -> int:
    """The first that is not more than so much, or the least."""
    possible = np.flatnonzero(found <= most)
    return int(possible[0] if len(possible) else found.argmin())
