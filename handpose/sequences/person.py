"""One person: bones and a surface that stay the same from frame to frame."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from handpose.body.model import Surface
from handpose.body.render import Capsules
from handpose.body.sides import Side, mirror_of
from handpose.synthetic.pose_prior import BodySampler, cut_normal
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
