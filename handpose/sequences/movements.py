"""A moving hand: position and pose at any time, interpolated smoothly between poses at some times.

Between poses a hand moves by strokes of least jerk (Flash and Hogan 1985), which may overlap, as in people
(Flash and Henis 1991): with s from 0 to 1 within a stroke

    value(t) = first + sum over strokes of e(s) step          e(s) = 10 s³ - 15 s⁴ + 6 s⁵
    R(t)     = R_first, times exp(e(s) step) of each stroke    for rotations: the shortest way, at a steady axis

so positions, speeds and accelerations are continuous. Strokes that begin in order end in order, hence a value is
always a mean of the poses: no angle leaves limits that the poses keep. A stroke's top speed is 1.875 times its mean.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from handpose.body.render import Capsules
from handpose.body.sides import Side
from handpose.sequences.person import Person
from handpose.synthetic.pose_prior import BodySampler
from handpose.tracking.track import joints_of
from netlib.blob import Array

TOP_SPEED = 1.875  # top speed of a stroke, relative to its mean speed
OVERLAP = 0.3  # share of the shorter of two strokes: their speeds together stay below the top speed of one


def eased(part: Array) -> Array:
    """The fraction (n,) of a movement that is done after these fractions of its time, eased in and out."""
    s = np.clip(part, 0, 1)
    return np.asarray(s * s * s * (10 - 15 * s + 6 * s * s))


class Strokes:
    """Strokes in the order of time: when they begin and how long they last, in s."""

    def __init__(self) -> None:
        self.begins: list[float] = []
        self.lasts: list[float] = []

    @property
    def end(self) -> float:
        """The end of the last one, s."""
        return self.begins[-1] + self.lasts[-1] if self.begins else 0.0

    def add(self, begin: float, lasts: float) -> None:
        """Add a stroke that begins and ends no earlier than the one before."""
        assert lasts > 0 and (not self.begins or (begin >= self.begins[-1] and begin + lasts >= self.end))
        self.begins.append(begin)
        self.lasts.append(lasts)

    def done(self, time: float) -> Array:
        """The completed fraction (n,) of each."""
        return eased((time - np.array(self.begins)) / np.array(self.lasts))


class Values:
    """Numbers (n,) over time."""

    def __init__(self, first: Array) -> None:
        self.keys = [np.asarray(first, dtype=np.float64)]
        self.strokes = Strokes()

    def move(self, begin: float, lasts: float, to: Array) -> None:
        """Add a stroke."""
        self.strokes.add(begin, lasts)
        self.keys.append(np.asarray(to, dtype=np.float64))

    def at(self, time: float) -> Array:
        """Their values (n,) at a time in s."""
        if len(self.keys) == 1:
            return self.keys[0]
        return np.asarray(self.keys[0] + self.strokes.done(time) @ np.diff(self.keys, axis=0))


class Turns:
    """A rotation over time, its poses as scipy's rotations."""

    def __init__(self, first: Rotation) -> None:
        self.keys = [first]
        self.strokes = Strokes()

    def move(self, begin: float, lasts: float, to: Rotation) -> None:
        """Add a stroke."""
        self.strokes.add(begin, lasts)
        self.keys.append(to)

    def at(self, time: float) -> Rotation:
        """The rotation at a time in s."""
        done = self.strokes.done(time) if self.strokes.begins else np.zeros(0)
        whole = int(np.count_nonzero(done == 1))
        turned = self.keys[whole]
        for k in range(whole, int(np.count_nonzero(done > 0))):
            turned = turned * Rotation.from_rotvec(done[k] * (self.keys[k].inv() * self.keys[k + 1]).as_rotvec())
        return turned


class HandPose(NamedTuple):
    """One hand at one time.

    inputs     (D,) of the skeleton, of a left hand those of its mirror image; angles of the palm in -pi to pi
    bones      (K,) in units
    origin_mm  (3,) camera axes, not mirrored: where the inputs' origin is, the middle of a crop
    xyz        (K, 3) mm, camera axes
    capsules   (1, M) mm, camera axes: hand and forearm
    """

    inputs: Array
    bones: Array
    origin_mm: Array
    xyz: Array
    capsules: Capsules


class Movement:
    """One hand of a person, over time.

    side     "right" or "left"
    fingers  the inputs of fingers and thumb, (D,) of the skeleton; the others are 0
    palm     its rotation, world_from_palm; for a left hand that of its mirror image
    arm      the inputs of the forearm, which only the surface has
    place    (3,) mm, camera axes: centre of a crop
    """

    def __init__(
        self, sampler: BodySampler, person: Person, side: Side, fingers: Array, palm: Rotation, arm: Array, place: Array
    ) -> None:
        self.sampler, self.person, self.side = sampler, person, side
        self.fingers, self.palm = Values(fingers), Turns(palm)
        self.arm, self.place = Values(arm), Values(place)

    def pose_at(self, time: float) -> HandPose:
        """The hand at a time in s."""
        origin, whole = self.place.at(time), self.inputs_at(time)
        skeleton, person = self.sampler.skeleton, self.person
        inputs, bones = whole[: len(skeleton.initial)], person.bones[: len(skeleton.joint_names)]
        xyz = joints_of(skeleton, person.unit_mm, self.side, inputs, bones, origin)
        return HandPose(inputs, bones, origin, xyz, person.capsules(whole, origin, self.side))

    def inputs_at(self, time: float) -> Array:
        """The inputs (D,) of the whole body, the forearm included."""
        fingers, palm, arm = self.fingers.at(time), self.palm.at(time), self.arm.at(time)
        return np.asarray(posed(self.sampler, self.person, fingers[None], Rotation.concatenate([palm]), arm[None])[0])


def posed(sampler: BodySampler, person: Person, fingers: Array, palm: Rotation, arm: Array) -> Array:
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
