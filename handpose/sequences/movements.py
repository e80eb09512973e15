"""A person with the same bones and surface in every frame, poses that its fingers reach, and
the movement of its hand: position and pose at any time, interpolated smoothly between poses
at some times.

Between poses a hand moves by strokes of least jerk (Flash and Hogan 1985), which may overlap, as in
people (Flash and Henis 1991): with s from 0 to 1 within a stroke

    value(t) = first + sum over strokes of e(s) step          e(s) = 10 s³ - 15 s⁴ + 6 s⁵
    R(t)     = R_first, times exp(e(s) step) of each stroke
               for rotations: the shortest way, at a steady axis

so positions, speeds and accelerations are continuous. Strokes that begin in order end in order,
hence a value is always a mean of the poses: no angle leaves limits that the poses keep. A stroke's
top speed is 1.875 times its mean.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from handpose.body.capsules import Capsules
from handpose.body.model import Surface
from handpose.body.nyu import CUBE_MM
from handpose.body.sides import Side, mirror_of
from handpose.frames.cameras import Camera
from handpose.synthetic.pose_prior import BodySampler, cut_normal
from handpose.synthetic.surface_prior import PERSON_SURFACE
from handpose.tracking.track import HandPose, joints_of
from netlib.blob import Array


@dataclass(frozen=True)
class Person:
    """A hand with its forearm, as a right hand. Lengths are in units of ``unit_mm``.

    surface    the surface of the skeleton, with the capsules
    bones    (K,) of the whole body, signed
    size     relative to the skeleton's
    radii    (M, 2) of the capsules
    offset   factor of the skeleton file's offsets of capsules from their joints
    sleeve   fraction of the forearm where it starts, and its thickness; thickness 0 is none
    unit_mm  length unit
    center   (3,) in units, palm frame: centre of a crop
    """

    surface: Surface
    bones: Array
    size: float
    radii: Array
    offset: float
    sleeve: tuple[float, float]
    unit_mm: float
    center: Array

    @staticmethod
    def draw(rng: np.random.Generator, sampler: BodySampler) -> Person:
        """A random person."""
        hand, surface, prior = sampler.draw(rng, 1), sampler.surface, PERSON_SURFACE
        size = float(hand.scale[0])
        unit_mm = sampler.cube_mm / 2
        radii = surface.radii * size * cut_normal(rng, 1, prior.thickness_std, (), prior.clip)
        radii *= cut_normal(rng, 1, prior.radius_std, radii.shape, prior.clip)
        radii[surface.limbs] *= rng.uniform(*prior.limb)
        worn = rng.random() < prior.sleeve
        sleeve = (rng.uniform(*prior.sleeve_from), worn * rng.uniform(*prior.sleeve_mm) / unit_mm)
        offset = rng.uniform(*prior.offsets)
        return Person(
            surface, hand.bones[0], size, radii, offset, sleeve, unit_mm, sampler.center * size
        )

    def ends(self, inputs: Array) -> Array:
        """The capsules' ends (N, K, 3) in units for inputs (N, D) of the whole body."""
        pose = self.surface.kinematics.forward(
            inputs, np.broadcast_to(self.bones, (len(inputs), len(self.bones)))
        )
        return self.surface.ends(pose, self.size, self.offset)

    def penetration_mm(self, inputs: Array) -> Array:
        """The penetration (N,) of fingers into each other or into the palm."""
        radii = np.broadcast_to(self.radii, (len(inputs), *self.radii.shape))
        return self.surface.penetration(self.ends(inputs), radii) * self.unit_mm

    def capsules(self, inputs: Array, origin_mm: Array, side: Side) -> Capsules:
        """The capsules (1, M) in mm, camera axes, of inputs (D,) of the whole body with their
        origin at (3,).
        """
        ends = self.ends(inputs[None]) * self.unit_mm * mirror_of(side) + origin_mm
        radii = self.radii[None] * self.unit_mm
        a, b = ends[:, self.surface.start], ends[:, self.surface.end]
        return Capsules(a, b, radii[..., 0], radii[..., 1], self.surface.facets)

    def worn(self, capsules: Capsules) -> Capsules:
        """The sleeve (1, 1) over the forearm of ``capsules``."""
        a, b, ra, rb, _ = capsules.chosen(self.surface.limbs)
        first = self.sleeve[0]
        thicker = self.sleeve[1] * self.unit_mm
        start, radius = a + first * (b - a), ra + first * (rb - ra)
        return Capsules(start, b, radius + thicker, rb + thicker)


# -------------------------------------------------------------------------------------- named poses

OPEN = "open"  # the pose towards which a gesture is relaxed
RELAXING_STEPS = 9  # number of steps
POSE_DECIMALS = 4  # decimals of written poses


def fingers_of(name: str, person: Person, sampler: BodySampler) -> Array:
    """The inputs (D,) of a gesture's fingers, otherwise 0, as far as this person's fingers move
    without penetration.
    """
    opened, formed = sampler.poses[OPEN], sampler.poses[name]
    trials = formed + np.linspace(0, 1, RELAXING_STEPS)[:, None] * (opened - formed)
    whole = np.zeros((RELAXING_STEPS, len(person.surface.whole.initial)))
    whole[:, : trials.shape[1]] = trials
    fits = person.penetration_mm(whole) <= sampler.prior.penetration
    return trials[int(np.argmax(fits)) if fits.any() else -1]


def poses(sampler: BodySampler) -> dict[str, dict[str, float]]:
    """The limbs of every pose on the skeleton's own body: inputs by DoF."""
    surface = sampler.surface
    unit_mm = sampler.cube_mm / 2
    person = Person(
        surface, surface.whole.bones, 1.0, surface.radii, 1.0, (1.0, 0.0), unit_mm, sampler.center
    )
    names = {int(d): sampler.skeleton.dof_names[int(d)] for d in sampler.limbs}
    found = {name: fingers_of(name, person, sampler) for name in sampler.poses}
    return {
        pose: {name: round(float(inputs[d]), POSE_DECIMALS) + 0.0 for d, name in names.items()}
        for pose, inputs in found.items()
    }


# ---------------------------------------------------------------------------------------- movements

TOP_SPEED = 1.875  # top speed of a stroke, relative to its mean speed
# share of the shorter of two strokes: their speeds together stay below the top speed of one
OVERLAP = 0.3


def eased(part: Array) -> Array:
    """The fraction (n,) of a movement that is done after these fractions of its time,
    eased in and out.
    """
    s = np.clip(part, 0, 1)
    polynomial = 10 - 15 * s + 6 * s * s
    return s * s * s * polynomial


class Values:
    """Numbers (n,) over time, which change by strokes in the order of time.

    keys           first, and after each stroke
    begins, lasts  when each stroke begins, and how long it lasts, in s
    """

    def __init__(self, first: Any) -> None:
        self.keys = [first]
        self.begins: list[float] = []
        self.lasts: list[float] = []

    @property
    def last(self) -> Any:
        """The values (n,) after the last stroke."""
        return self.keys[-1]

    @property
    def end(self) -> float:
        """The end of the last stroke, s."""
        return self.begins[-1] + self.lasts[-1] if self.begins else 0.0

    def begin(self, time: float, lasts: float) -> float:
        """When a stroke requested at a time begins: a successor starts somewhat before the
        last one ends.
        """
        if not self.begins or self.end < time:
            return time
        return self.end - OVERLAP * min(lasts, self.lasts[-1])

    def move(self, begin: float, lasts: float, to: Any) -> None:
        """Add a stroke that begins and ends no earlier than the one before."""
        assert lasts > 0
        assert not self.begins or (begin >= self.begins[-1] and begin + lasts >= self.end)
        self.begins.append(begin)
        self.lasts.append(lasts)
        self.keys.append(to)

    def done(self, time: float) -> Array:
        """The completed fraction (n,) of each stroke."""
        return eased((time - np.array(self.begins)) / np.array(self.lasts))

    def at(self, time: float) -> Any:
        """The values (n,) at a time in s."""
        if len(self.keys) == 1:
            return self.keys[0]
        return self.keys[0] + self.done(time) @ np.diff(self.keys, axis=0)


class Turns(Values):
    """A rotation over time, its poses as scipy's rotations."""

    def at(self, time: float) -> Rotation:
        """The rotation at a time in s."""
        done = self.done(time)
        whole = int(np.count_nonzero(done == 1))
        turned = self.keys[whole]
        for k in range(whole, int(np.count_nonzero(done > 0))):
            stroke = (self.keys[k].inv() * self.keys[k + 1]).as_rotvec()
            turned = turned * Rotation.from_rotvec(done[k] * stroke)
        return turned


@dataclass(frozen=True)
class Movement:
    """One hand of a person, over time.

    side     "right" or "left"
    fingers  the inputs of fingers and thumb, (D,) of the skeleton; the others are 0
    palm     its rotation, world_from_palm; for a left hand that of its mirror image
    arm      the inputs of the forearm, which only the surface has
    place    (3,) mm, camera axes: centre of a crop
    """

    sampler: BodySampler
    person: Person
    side: Side
    camera: Camera
    fingers: Values
    palm: Turns
    arm: Values
    place: Values

    def pose_at(self, time: float) -> HandPose:
        """The pose at a time in s."""
        origin = self.place.at(time)
        whole = self.inputs_at(time)
        skeleton = self.sampler.skeleton
        person = self.person
        inputs = whole[: len(skeleton.initial)]
        bones = person.bones[: len(skeleton.joint_names)]
        xyz = joints_of(skeleton, person.unit_mm, self.side, inputs, bones, origin)
        return HandPose(
            skeleton,
            self.side,
            inputs,
            bones,
            origin,
            xyz,
            self.camera.project(origin),
            CUBE_MM,
            surface=partial(person.capsules, whole, origin, self.side),
        )

    def inputs_at(self, time: float) -> Array:
        """The inputs (D,) of the whole body, the forearm included."""
        fingers, palm, arm = self.fingers.at(time), self.palm.at(time), self.arm.at(time)
        return posed(
            self.sampler, self.person, fingers[None], Rotation.concatenate([palm]), arm[None]
        )[0]


def posed(
    sampler: BodySampler, person: Person, fingers: Array, palm: Rotation, arm: Array
) -> Array:
    """The inputs (N, D) of the whole body that put the crops' centres at the origin.

    fingers  (N, D) of the skeleton
    palm     N rotations
    arm      (N, D) inputs of the surface alone
    """
    initial = sampler.skeleton.initial
    whole = np.concatenate([fingers, arm], axis=1)
    z, x, y = palm.as_euler("ZXY").T
    angles = np.stack([z, x, -y], axis=1) - initial[sampler.rotation]
    whole[:, sampler.rotation] = (angles + np.pi) % (2 * np.pi) - np.pi
    whole[:, sampler.translation] = -palm.apply(person.center) - initial[sampler.translation]
    return whole
