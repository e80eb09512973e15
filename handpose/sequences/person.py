"""One person: bones and a surface that stay the same from frame to frame, and named poses that its fingers reach."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from handpose.body.model import Surface
from handpose.body.render import Capsules
from handpose.body.sides import Side, mirror_of
from handpose.synthetic.pose_prior import BodySampler, cut_normal
from handpose.synthetic.prior_file import PartParameter, PoseParameter
from handpose.synthetic.surface_prior import PERSON_SURFACE, SurfacePrior
from netlib.blob import Array

WHOLE_ARM = replace(PERSON_SURFACE, cut=0.0)  # arms do not end in empty space


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
    def draw(rng: np.random.Generator, sampler: BodySampler, prior: SurfacePrior = WHOLE_ARM) -> Person:
        """A random person."""
        hand, surface = sampler.draw(rng, 1), sampler.surface
        size, unit_mm = float(hand.scale[0]), sampler.cube_mm / 2
        radii = surface.radii * size * (1 + prior.thickness_std * cut_normal(rng, (), prior.clip))
        radii *= 1 + prior.radius_std * cut_normal(rng, radii.shape, prior.clip)
        radii[surface.limbs] *= rng.uniform(*prior.limb)
        worn = rng.random() < prior.sleeve
        sleeve = float(rng.uniform(*prior.sleeve_from)), worn * float(rng.uniform(*prior.sleeve_mm)) / unit_mm
        offset = float(rng.uniform(*prior.offsets))
        return Person(surface, hand.bones[0], size, radii, offset, sleeve, unit_mm, sampler.center * size)

    def joints(self, inputs: Array) -> Array:
        """Joints (N, K, 3) in units of inputs (N, D) of the whole body."""
        return self.surface.kinematics.joints(inputs, self._bones(len(inputs)))

    def ends(self, inputs: Array) -> Array:
        """The capsules' ends (N, K, 3) in units for inputs (N, D) of the whole body."""
        pose = self.surface.kinematics.forward(inputs, self._bones(len(inputs)))
        return self.surface.ends(pose, self.size, self.offset)

    def penetration_mm(self, inputs: Array) -> Array:
        """The penetration (N,) of fingers into each other or into the palm."""
        radii = np.broadcast_to(self.radii, (len(inputs), *self.radii.shape))
        return self.surface.penetration(self.ends(inputs), radii) * self.unit_mm

    def capsules(self, inputs: Array, origin_mm: Array, side: Side) -> Capsules:
        """The capsules (1, M) in mm, camera axes, of inputs (D,) of the whole body with their origin at (3,)."""
        ends = self.ends(inputs[None]) * self.unit_mm * mirror_of(side) + origin_mm
        radii = self.radii[None] * self.unit_mm
        return Capsules(ends[:, self.surface.start], ends[:, self.surface.end], radii[..., 0], radii[..., 1],
                        self.surface.facets)

    def worn(self, capsules: Capsules) -> Capsules:
        """The sleeve (1, 1) over the forearm of ``capsules``."""
        a, b, ra, rb, _ = capsules.chosen(self.surface.limbs)
        first, thicker = self.sleeve[0], self.sleeve[1] * self.unit_mm
        return Capsules(a + first * (b - a), b, ra + first * (rb - ra) + thicker, rb + thicker)

    def _bones(self, count: int) -> Array:
        return np.broadcast_to(self.bones, (count, len(self.bones)))


# ---------------------------------------------------------------------------------------------- named poses

OPEN = "open"  # the pose towards which a gesture is relaxed
STEPS = 9  # number of steps
DECIMALS = 4  # decimals of written poses


def fingers_of(name: str, person: Person, sampler: BodySampler) -> Array:
    """The inputs (D,) of a gesture's fingers, otherwise 0, as far as this person's fingers move without penetration."""
    opened, formed = sampler.poses[OPEN], sampler.poses[name]
    trials = formed + np.linspace(0, 1, STEPS)[:, None] * (opened - formed)
    whole = np.zeros((STEPS, len(person.surface.whole.initial)))
    whole[:, : trials.shape[1]] = trials
    fits = person.penetration_mm(whole) <= sampler.prior.penetration
    return np.asarray(trials[int(np.argmax(fits)) if fits.any() else -1])


def poses(sampler: BodySampler) -> dict[str, dict[str, float]]:
    """The limbs of every pose on the skeleton's own body: inputs by DoF."""
    surface, unit_mm = sampler.surface, sampler.cube_mm / 2
    person = Person(surface, surface.whole.bones, 1.0, surface.radii, 1.0, (1.0, 0.0), unit_mm, sampler.center)
    names = {int(d): sampler.skeleton.dof_names[int(d)] for d in sampler.limbs}
    found = {name: fingers_of(name, person, sampler) for name in sampler.poses}
    return {
        pose: {name: round(float(inputs[d]), DECIMALS) + 0.0 for d, name in names.items()}
        for pose, inputs in found.items()
    }


# The gestures in the recordings on which recognition is measured. Unlike the poses of the prior files, about which
# training data are drawn, the thumb is out or across the palm as in the gesture's definition, and a pinch touches.
_OUT = {"thumb_pip_rot_y": 0.5, "thumb_pip_rot_z": 0.1, "thumb_dip_rot_z": 0.7, "thumb_tip_rot_z": 0.4}
_ACROSS = {"thumb_pip_rot_y": 0.3, "thumb_pip_rot_z": 0.75, "thumb_dip_rot_z": 0.8, "thumb_tip_rot_z": 0.3}
_FOLDED = {"thumb_pip_rot_y": 0.7, "thumb_pip_rot_z": 0.72, "thumb_dip_rot_z": 0.97, "thumb_tip_rot_z": 0.94}
_TOUCHING = {
    "thumb_pip_rot_y": 0.39, "thumb_pip_rot_z": 0.57, "thumb_dip_rot_z": 0.68, "thumb_tip_rot_z": 0.59,
    "index_base_rot_x": 0.58, "index_base_rot_z": 0.46, "index_pip_rot_x": 0.33, "index_dip_rot_x": 0.33,
}


def _pose(name: str, bends: tuple[float, float, float, float], at: dict[str, float]) -> PoseParameter:
    """A pose: the bends of index to little finger with their knuckles, and DoFs as fractions of their ranges."""
    bent = [
        PartParameter(chain, bend)
        for of, bend in zip(("index", "middle", "ring", "little"), bends)
        for chain in (of, f"{of}_knuckle")
        if bend >= 0
    ]
    return PoseParameter(name, tuple(bent), tuple(PartParameter(of, part) for of, part in at.items()))


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
