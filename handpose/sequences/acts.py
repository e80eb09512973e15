"""The acts of a hand in a synthetic recording, the movements they consist of, and the volume in
which it moves.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from handpose.body.sides import Side, mirror_of
from handpose.frames.cameras import Camera
from handpose.sequences.movements import TOP_SPEED, Movement, Person, Values, fingers_of, posed
from handpose.synthetic.pose_prior import BodySampler
from netlib.blob import Array

MAX_TURN = np.deg2rad(80)  # maximum turn of a palm in one stroke
ARM_DEVIATION = 0.6  # share of the skeleton file's limits, which are for any hand
# the most of a forearm's direction to the camera, up, and to the other hand
TOWARDS, UPWARDS, INWARDS = 0.35, 0.2, 0.5
CANDIDATES = 16  # the first possible one is taken, otherwise the best
ON_THE_WAY = 5  # poses on the way, including the last, at which fingers are checked
MARGIN_MM = 155.0  # from the middle of a crop to the border of the volume
GONE_MM = 330.0  # from the border of the image to the middle of a hand that is away


class Volume(NamedTuple):
    """The volume of a moving hand: a part of the image, and depths in mm."""

    camera: Camera
    left: float = 0.0  # 0 to 1 of the image's width
    right: float = 1.0
    near: float = 450.0
    far: float = 850.0

    def roomy(self) -> Volume:
        """The volume, starting far enough from the camera for a hand and its movement."""
        c = self.camera
        width = (self.right - self.left) * c.width
        needed = 1.15 * 2 * MARGIN_MM * max(c.fx / width, c.fy / c.height)
        return self._replace(near=max(self.near, needed), far=max(self.far, 1.4 * needed))

    def place(self, rng: np.random.Generator) -> Array:
        """A place (3,) for the middle of a hand, in mm."""
        z = rng.uniform(self.near, self.far)
        columns, rows = self._pixels(z)
        return self.camera.unproject((rng.uniform(*columns), rng.uniform(*rows), z))

    def kept(self, place: Array) -> Array:
        """The place (3,) within the volume that is nearest to another, about."""
        z = float(np.clip(place[2], self.near, self.far))
        columns, rows = self._pixels(z)
        u, v, _ = self.camera.project([place[0], place[1], z])
        return self.camera.unproject((np.clip(u, *columns), np.clip(v, *rows), z))

    def _pixels(self, z: float) -> tuple[tuple[float, float], tuple[float, float]]:
        """The first and last column, and row, of the middle of a hand at a depth."""
        c = self.camera
        across, down = MARGIN_MM * c.fx / z, MARGIN_MM * c.fy / z
        columns = self.left * c.width + across, self.right * c.width - across
        return columns, (down, c.height - down)

    def outside(self, place: Array) -> Array:
        """The position (3,) outside the image next to another one, at the closer side."""
        c = self.camera
        z = place[2]
        u, v, _ = c.project(place)
        margin = GONE_MM * c.fx / z
        is_left = u < (c.width - 1) / 2
        return c.unproject((-margin if is_left else c.width + margin, v, z))


def _first(found: Array, most: float) -> int:
    """The index of the first value within the bound, otherwise of the lowest."""
    possible = np.flatnonzero(found <= most)
    return int(possible[0] if len(possible) else found.argmin())


Kind = Literal["rest", "gestures", "wave", "moving", "away"]

FINGER_SPEED, PALM_SPEED, HAND_SPEED = 6.0, 4.0, 1000.0  # maximum speeds: rad/s, rad/s, mm/s
STROKE = (0.5, 1.5)  # s: duration of a stroke; longer if it would be too fast
BOUT, REST = (3.0, 5.0), (1.1, 1.6)  # s: durations of movement and of the rest after it
WAVE = np.deg2rad(25)  # maximum turn of a palm to either side
WAVE_S = 0.35  # of a turn
FACING = 0.35  # factor of the prior's pitch and yaw while gestures are shown
SWAY_MM = 25.0  # deviation of a hand's place while it shows gestures


@dataclass(frozen=True)
class Act:
    """One act and its duration in s, above 0.

    rest      keep still
    gestures  show gestures in random order, each for a while, with a slightly swaying position:
              those of ``of``, or all
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
        self,
        rng: np.random.Generator,
        sampler: BodySampler,
        person: Person,
        side: Side,
        volume: Volume,
        outward: float,
    ) -> None:
        self.rng, self.sampler, self.person, self.side, self.volume = (
            rng,
            sampler,
            person,
            side,
            volume,
        )
        self.outward = outward
        self.time = 0.0
        fingers = fingers_of("relaxed", person, sampler)
        palm, arm = self.next_palm(None, FACING)
        self.movement = Movement(
            sampler, person, side, volume.camera, fingers, palm, arm, volume.place(rng)
        )

    def act(self, acts: Sequence[Act], seconds: float) -> Movement:
        """Perform the acts in a loop until the given time in s is over, which does not
        change the movement.

        An act that begins while a hand still returns is performed, too.
        """
        n = 0
        while min(self.time, self.movement.place.begin(self.time, np.inf)) < seconds:
            act = acts[n % len(acts)]
            end = self.time + act.seconds
            if act.kind == "away":
                self._away(end, first=n == 0)
            elif act.kind == "gestures":
                self._gestures(act.of, end)
            elif act.kind == "wave":
                self._wave(end)
            elif act.kind == "moving":
                self._moving(end)
            self.time = end
            n += 1
        return self.movement

    # ----------------------------------------------------------------------------------------- acts

    def _gestures(self, of: tuple[str, ...], end: float) -> None:
        names: list[str] = []
        self._turn(*self.next_palm(self.movement.palm.last, FACING), self.rng.uniform(*STROKE), end)
        middle = self.movement.place.last
        while self.time < end:
            names = names or [
                str(name) for name in self.rng.permutation(list(of or self.sampler.poses))
            ]
            began = self.time
            if not self._show(fingers_of(names.pop(), self.person, self.sampler), end):
                return
            sway = middle + SWAY_MM * self.rng.standard_normal(3)
            self._go(self.volume.kept(sway), began, end)
            self.time += self.rng.uniform(0.4, 1.2)

    def _wave(self, end: float) -> None:
        palm = self.movement.palm
        began = self.time
        self._show(fingers_of("five", self.person, self.sampler), end)
        middle = palm.last
        side = 1.0
        self.time = began
        waved = {way: Rotation.from_rotvec([0, 0, way * WAVE]) * middle for way in (1.0, -1.0)}
        while self._turn(waved[side], self.movement.arm.last, WAVE_S, end):
            side = -side

    def _moving(self, end: float) -> None:
        """Fingers, palm and position have movements at different times."""
        while self.time < end:
            began = self.time
            bout = min(self.time + self.rng.uniform(*BOUT), end)
            while self._show(self.next_fingers(self.movement.fingers.last), bout):
                pass
            self.time = began
            while self._turn(
                *self.next_palm(self.movement.palm.last), self.rng.uniform(*STROKE), bout
            ):
                pass
            self.time = began
            while self._go(self.volume.place(self.rng), self.time, bout):
                pass
            self.time = bout + self.rng.uniform(*REST)

    def _away(self, end: float, first: bool) -> None:
        place = self.movement.place
        inside = place.last
        outside = self.volume.outside(inside)
        if first:
            place.keys[-1] = outside
        else:
            self._go(outside, self.time, np.inf)
        lasts = TOP_SPEED * float(np.linalg.norm(outside - inside)) / HAND_SPEED
        place.move(max(end - lasts, place.end), lasts, inside)

    # -------------------------------------------------------------------------------------- strokes

    def _show(self, fingers: Array, end: float) -> bool:
        """Move the fingers, through the open hand if they would collide; False if
        ``end`` is too early.
        """
        values = self.movement.fingers
        ways = [fingers]
        if self.depth_between(values.last, fingers[None])[0] > self.sampler.prior.penetration:
            ways.insert(0, fingers_of("open", self.person, self.sampler))
        for way in ways:
            angle = float(np.abs(way - values.last).max())
            lasts = max(self.rng.uniform(*STROKE), TOP_SPEED * angle / FINGER_SPEED)
            if not self._stroke(values, way, lasts, self.time, end):
                return False
        return True

    def _turn(self, palm: Rotation, arm: Array, lasts: float, end: float) -> bool:
        """Turn the palm and the forearm."""
        turns = self.movement.palm
        arm_angle = float(np.abs(arm - self.movement.arm.last).max())
        angle = (turns.last.inv() * palm).magnitude() + arm_angle
        lasts = max(lasts, TOP_SPEED * angle / PALM_SPEED)
        if not self._stroke(turns, palm, lasts, self.time, end):
            return False
        self.movement.arm.move(turns.begins[-1], lasts, arm)
        return True

    def _go(self, to: Array, time: float, end: float) -> bool:
        """Move the hand to a position."""
        place = self.movement.place
        distance = float(np.linalg.norm(to - place.last))
        lasts = max(self.rng.uniform(*STROKE), TOP_SPEED * distance / HAND_SPEED)
        return self._stroke(place, to, lasts, time, end)

    def _stroke(self, values: Values, to: Any, lasts: float, time: float, end: float) -> bool:
        """Add a stroke that may begin at a time; False if it would not end by ``end``."""
        begin = values.begin(time, lasts)
        if begin + lasts > end:
            return False
        values.move(begin, lasts, to)
        self.time = max(self.time, begin + lasts)
        return True

    # -------------------------------------------------------------------------------------- choices

    def next_fingers(self, before: Array) -> Array:
        """Finger inputs (D,) that can be reached from ``before`` without collisions."""
        drawn = self.sampler.draw(self.rng, CANDIDATES).inputs
        drawn[:, [*self.sampler.rotation, *self.sampler.translation]] = 0
        depth = self.depth_between(before, drawn)
        return drawn[_first(depth, self.sampler.prior.penetration)]

    def depth_between(self, before: Array, after: Array) -> Array:
        """The penetration (N,) of fingers in mm on the way from one pose (D,) to others (N, D)."""
        parts = np.linspace(0, 1, ON_THE_WAY + 1)[1:, None, None]
        way = before + parts * (after - before)
        whole = np.zeros((way[..., 0].size, len(self.person.surface.whole.initial)))
        whole[:, : way.shape[-1]] = way.reshape(len(whole), -1)
        return self.person.penetration_mm(whole).reshape(len(way), -1).max(axis=0)

    def next_palm(self, before: Rotation | None, facing: float = 1.0) -> tuple[Rotation, Array]:
        """A palm rotation and the inputs of its forearm, such that the arm can be that of a person
        at the camera.

        before  the palm rotation to start from, if there is one
        facing  factor of pitch and yaw
        """
        sampler = self.sampler
        surface = self.sampler.surface
        own = len(sampler.skeleton.initial)
        palms = Rotation.from_euler(
            "ZXY", sampler.rotations(self.rng, CANDIDATES) * (1, facing, -facing)
        )
        free = own + np.flatnonzero(~surface.whole.fixed[own:])
        arms = np.zeros((CANDIDATES, len(surface.whole.initial)))
        arms[:, free] = (
            ARM_DEVIATION
            * surface.deviation[free]
            * self.rng.standard_normal((CANDIDATES, len(free)))
        )
        arms = np.clip(arms, surface.whole.lower, surface.whole.upper)[:, own:]
        chosen = _first(self._strain(before, palms, arms), 0.0)
        return palms[chosen], arms[chosen]

    def _strain(self, before: Rotation | None, palms: Rotation, arms: Array) -> Array:
        """The implausibility (N,) of palms and forearms, also on the way; 0 is plausible."""
        surface = self.sampler.surface
        count = len(arms)
        steps = np.zeros((count, 3)) if before is None else (before.inv() * palms).as_rotvec()
        over = np.zeros(count)
        for left in (0.0, 0.5):
            way = palms * Rotation.from_rotvec(-left * steps)
            none = np.zeros((count, len(self.sampler.skeleton.initial)))
            ends = self.person.ends(posed(self.sampler, self.person, none, way, arms))
            first, last = surface.start[surface.limbs], surface.end[surface.limbs]
            limb = (ends[:, last] - ends[:, first])[:, 0]
            limb = limb / np.linalg.norm(limb, axis=1, keepdims=True) * mirror_of(self.side)
            x, y, z = limb.T
            too_far = np.stack([-z - TOWARDS, y - UPWARDS, -x * self.outward - INWARDS])
            over = np.maximum(over, np.maximum(too_far, 0).sum(axis=0))
        return over + np.maximum(np.linalg.norm(steps, axis=1) - MAX_TURN, 0)
