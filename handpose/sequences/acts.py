"""The acts of a hand in a synthetic recording, the movements they consist of, and the volume in
which it moves.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from handpose.body.sides import Side, mirror_of
from handpose.frames.cameras import Camera
from handpose.sequences.movements import (
    TOP_SPEED,
    Movement,
    Person,
    Turns,
    Values,
    fingers_of,
    posed,
)
from handpose.synthetic.pose_prior import BodySampler
from netlib.blob import Array

MAX_TURN = np.deg2rad(80)  # maximum turn of a palm in one stroke
ARM_DEVIATION = 0.6  # share of the skeleton file's deviations, which are for any hand
# maximum components of a forearm's direction: to the camera, up, and to the other hand
MAX_TOWARDS, MAX_UPWARDS, MAX_INWARDS = 0.35, 0.2, 0.5
CANDIDATES = 16  # the first possible one is taken, otherwise the best
WAYPOINTS = 5  # poses between two others, including the last, at which fingers are checked
MARGIN_MM = 155.0  # from the middle of a crop to the border of the volume
GONE_MM = 330.0  # from the border of the image to the middle of a hand that is away
MIN_ROOM = 1.15  # minimum size of the volume's near end, relative to the crop
MIN_DEPTH_RATIO = 1.4  # minimum ratio of the depths of the volume's far and near ends


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
        needed = MIN_ROOM * 2 * MARGIN_MM * max(c.fx / width, c.fy / c.height)
        far = max(self.far, MIN_DEPTH_RATIO * needed)
        return self._replace(near=max(self.near, needed), far=far)

    def place(self, rng: np.random.Generator) -> Array:
        """A place (3,) for the middle of a hand, in mm."""
        z = rng.uniform(self.near, self.far)
        columns, rows = self._pixels(z)
        return self.camera.unproject((rng.uniform(*columns), rng.uniform(*rows), z))

    def clipped(self, place: Array) -> Array:
        """The place (3,) within the volume that is nearest to another, about."""
        x, y, z = place
        z = float(np.clip(z, self.near, self.far))
        columns, rows = self._pixels(z)
        u, v, _ = self.camera.project([x, y, z])
        return self.camera.unproject((np.clip(u, *columns), np.clip(v, *rows), z))

    def _pixels(self, z: float) -> tuple[tuple[float, float], tuple[float, float]]:
        """The first and last column, and row, of the middle of a hand at a depth."""
        c = self.camera
        across, down = MARGIN_MM * c.fx / z, MARGIN_MM * c.fy / z
        columns = self.left * c.width + across, self.right * c.width - across
        return columns, (down, c.height - down)

    def outside(self, place: Array) -> Array:
        """The place (3,) outside the image next to another one, at the closer side."""
        c = self.camera
        u, v, z = c.project(place)
        margin = GONE_MM * c.fx / z
        is_left = u < (c.width - 1) / 2
        return c.unproject((-margin if is_left else c.width + margin, v, z))


def _first_within(bound: float, values: Array) -> int:
    """The index of the first value within the bound, otherwise of the lowest."""
    within = np.flatnonzero(values <= bound)
    return int(within[0] if len(within) else values.argmin())


Kind = Literal["rest", "gestures", "wave", "moving", "away"]

MAX_FINGER_RAD_S, MAX_PALM_RAD_S, MAX_HAND_MM_S = 6.0, 4.0, 1000.0  # maximum speeds
STROKE_S = (0.5, 1.5)  # range of the duration of a stroke; longer if it would be too fast
BOUT_S, REST_S = (3.0, 5.0), (1.1, 1.6)  # ranges of movement and of the rest after it
HOLD_S = (0.4, 1.2)  # range of the time for which a gesture is shown
WAVE_RAD, WAVE_S = np.deg2rad(25), 0.35  # turn of a waving palm to either side, and its duration
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
        self.rng, self.sampler, self.person = rng, sampler, person
        self.side, self.volume, self.outward = side, volume, outward
        self.time = 0.0
        fingers = Values(self._gesture("relaxed"))
        palm, arm = self.next_palm(None, FACING)
        place = Values(volume.place(rng))
        self.movement = Movement(
            sampler, person, side, volume.camera, fingers, Turns(palm), Values(arm), place
        )

    def act(self, acts: Sequence[Act], seconds: float) -> Movement:
        """Perform the acts in a loop until the given time in s is over. Movement before that
        time does not depend on it.

        An act that begins while a hand still returns is performed, too.
        """
        place = self.movement.place
        for act in itertools.cycle(acts):
            if min(self.time, place.begin(self.time, np.inf)) >= seconds:
                break
            end = self.time + act.seconds
            if act.kind == "away":
                self._away(end)
            elif act.kind == "gestures":
                self._gestures(act.of or tuple(self.sampler.poses), end)
            elif act.kind == "wave":
                self._wave(end)
            elif act.kind == "moving":
                self._moving(end)
            self.time = end
        return self.movement

    # ----------------------------------------------------------------------------------------- acts

    def _gestures(self, names: tuple[str, ...], end: float) -> None:
        self._turn_to_next_palm(FACING, end)
        middle = self.movement.place.last
        shuffled: list[str] = []
        while self.time < end:
            shuffled = shuffled or self.rng.permutation(names).tolist()
            began = self.time
            if not self._show(self._gesture(shuffled.pop()), end):
                return
            swayed = middle + SWAY_MM * self.rng.standard_normal(3)
            self._go(self.volume.clipped(swayed), began, end)
            self.time += self.rng.uniform(*HOLD_S)

    def _wave(self, end: float) -> None:
        began = self.time
        self._show(self._gesture("five"), end)
        self.time = began
        middle = self.movement.palm.last
        left, right = (Rotation.from_rotvec([0, 0, z]) * middle for z in (WAVE_RAD, -WAVE_RAD))
        for palm in itertools.cycle((left, right)):
            if not self._turn(palm, self.movement.arm.last, WAVE_S, end):
                break

    def _moving(self, end: float) -> None:
        """Fingers, palm and place have movements at different times."""
        while self.time < end:
            began = self.time
            bout_end = min(began + self.rng.uniform(*BOUT_S), end)
            while self._show(self.next_fingers(self.movement.fingers.last), bout_end):
                pass
            self.time = began
            while self._turn_to_next_palm(1.0, bout_end):
                pass
            self.time = began
            while self._go(self.volume.place(self.rng), self.time, bout_end):
                pass
            self.time = bout_end + self.rng.uniform(*REST_S)

    def _away(self, end: float) -> None:
        place = self.movement.place
        inside = place.last
        outside = self.volume.outside(inside)
        if self.time == 0:
            place.keys[-1] = outside
        else:
            self._go(outside, self.time, np.inf)
        duration = TOP_SPEED * float(np.linalg.norm(outside - inside)) / MAX_HAND_MM_S
        place.move(max(end - duration, place.end), duration, inside)

    # -------------------------------------------------------------------------------------- strokes

    # Each of these returns False, without the stroke, if it would not end by ``end``; otherwise
    # ``time`` is at least its end.

    def _show(self, fingers: Array, end: float) -> bool:
        """Move the fingers, through the open hand if they would collide."""
        values = self.movement.fingers
        targets = [fingers]
        if self.depth_between(values.last, fingers[None])[0] > self.sampler.prior.penetration:
            targets = [self._gesture("open"), fingers]
        for target in targets:
            angle = float(np.abs(target - values.last).max())
            duration = max(self.rng.uniform(*STROKE_S), TOP_SPEED * angle / MAX_FINGER_RAD_S)
            if not self._stroke(values, target, duration, self.time, end):
                return False
        return True

    def _turn_to_next_palm(self, facing: float, end: float) -> bool:
        palm, arm = self.next_palm(self.movement.palm.last, facing)
        return self._turn(palm, arm, self.rng.uniform(*STROKE_S), end)

    def _turn(self, palm: Rotation, arm: Array, duration: float, end: float) -> bool:
        """Turn the palm and the forearm, in ``duration`` or longer."""
        turns = self.movement.palm
        arm_angle = float(np.abs(arm - self.movement.arm.last).max())
        angle = (turns.last.inv() * palm).magnitude() + arm_angle
        duration = max(duration, TOP_SPEED * angle / MAX_PALM_RAD_S)
        if not self._stroke(turns, palm, duration, self.time, end):
            return False
        self.movement.arm.move(turns.begins[-1], duration, arm)
        return True

    def _go(self, target: Array, time: float, end: float) -> bool:
        """Move the hand to a place, at ``time`` or later."""
        place = self.movement.place
        distance = float(np.linalg.norm(target - place.last))
        duration = max(self.rng.uniform(*STROKE_S), TOP_SPEED * distance / MAX_HAND_MM_S)
        return self._stroke(place, target, duration, time, end)

    def _stroke(
        self, values: Values, target: Any, duration: float, time: float, end: float
    ) -> bool:
        """Change values by a stroke, at ``time`` or later."""
        begin = values.begin(time, duration)
        if begin + duration > end:
            return False
        values.move(begin, duration, target)
        self.time = max(self.time, begin + duration)
        return True

    # -------------------------------------------------------------------------------------- choices

    def _gesture(self, name: str) -> Array:
        return fingers_of(name, self.person, self.sampler)

    def next_fingers(self, before: Array) -> Array:
        """Finger inputs (D,) that can be reached from ``before`` without collisions."""
        fingers = self.sampler.draw(self.rng, CANDIDATES).inputs
        fingers[:, [*self.sampler.rotation, *self.sampler.translation]] = 0
        depths = self.depth_between(before, fingers)
        return fingers[_first_within(self.sampler.prior.penetration, depths)]

    def depth_between(self, before: Array, after: Array) -> Array:
        """The penetration (N,) of fingers in mm on the way from one pose (D,) to others (N, D)."""
        fractions = np.linspace(0, 1, WAYPOINTS + 1)[1:, None, None]
        poses = before + fractions * (after - before)
        D = poses.shape[-1]
        inputs = np.zeros((poses.size // D, len(self.person.surface.whole.initial)))
        inputs[:, :D] = poses.reshape(-1, D)
        return self.person.penetration_mm(inputs).reshape(WAYPOINTS, -1).max(axis=0)

    def next_palm(self, before: Rotation | None, facing: float = 1.0) -> tuple[Rotation, Array]:
        """A palm rotation and the inputs of its forearm, such that the arm can be that of a person
        at the camera.

        before  the palm rotation to start from, if there is one
        facing  factor of pitch and yaw
        """
        sampler, rng = self.sampler, self.rng
        whole, deviation = sampler.surface.whole, sampler.surface.deviation
        own = len(sampler.skeleton.initial)
        angles = sampler.rotations(rng, CANDIDATES) * (1, facing, -facing)
        palms = Rotation.from_euler("ZXY", angles)
        free = own + np.flatnonzero(~whole.fixed[own:])
        inputs = np.zeros((CANDIDATES, len(whole.initial)))
        noise = rng.standard_normal((CANDIDATES, len(free)))
        inputs[:, free] = ARM_DEVIATION * deviation[free] * noise
        arms = np.clip(inputs, whole.lower, whole.upper)[:, own:]
        chosen = _first_within(0.0, self._strain(before, palms, arms))
        return palms[chosen], arms[chosen]

    def _strain(self, before: Rotation | None, palms: Rotation, arms: Array) -> Array:
        """The implausibility (N,) of palms and forearms, also halfway; 0 is plausible."""
        count = len(arms)
        turns = np.zeros((count, 3)) if before is None else (before.inv() * palms).as_rotvec()
        halfway = palms * Rotation.from_rotvec(-0.5 * turns)
        excess = np.maximum(self._arm_excess(palms, arms), self._arm_excess(halfway, arms))
        return excess + np.maximum(np.linalg.norm(turns, axis=1) - MAX_TURN, 0)

    def _arm_excess(self, palms: Rotation, arms: Array) -> Array:
        """The sum (N,) of what a forearm's direction has above the maximum components."""
        surface = self.sampler.surface
        fingers = np.zeros((len(arms), len(self.sampler.skeleton.initial)))
        ends = self.person.ends(posed(self.sampler, self.person, fingers, palms, arms))
        first, last = surface.start[surface.limbs], surface.end[surface.limbs]
        forearm = (ends[:, last] - ends[:, first])[:, 0]
        direction = forearm / np.linalg.norm(forearm, axis=1, keepdims=True)
        x, y, z = (direction * mirror_of(self.side)).T
        inwards = -x * self.outward
        excess = np.stack([-z - MAX_TOWARDS, y - MAX_UPWARDS, inwards - MAX_INWARDS])
        return np.maximum(excess, 0).sum(axis=0)
