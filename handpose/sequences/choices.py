"""The next pose of a moving hand: drawn from the prior, and reachable for a person."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from handpose.body.sides import Side, mirror_of
from handpose.sequences.movements import posed
from handpose.sequences.person import Person
from handpose.synthetic.pose_prior import BodySampler
from netlib.blob import Array

MAX_TURN = np.deg2rad(80)  # maximum turn of a palm in one stroke
ARM_DEVIATION = 0.6  # share of the skeleton file's limits, which are for any hand
TOWARDS, UPWARDS, INWARDS = 0.35, 0.2, 0.5  # the most of a forearm's direction to the camera, up, and to the other hand
CANDIDATES = 16  # the first possible one is taken, otherwise the best
ON_THE_WAY = 5  # poses on the way, including the last, at which fingers are checked


class Choices:
    """Draws the next pose of one hand.

    side     "right" or "left"
    outward  -1 or 1: the side, along x, on which its elbow stays; 0 for none
    """

    def __init__(
        self, rng: np.random.Generator, sampler: BodySampler, person: Person, side: Side, outward: float
    ) -> None:
        self.rng, self.sampler, self.person, self.side, self.outward = rng, sampler, person, side, outward

    def fingers(self, before: Array) -> Array:
        """Finger inputs (D,) that can be reached from ``before`` without collisions."""
        drawn = self.sampler.draw(self.rng, CANDIDATES).inputs
        drawn[:, [*self.sampler.rotation, *self.sampler.translation]] = 0
        depth = self.depth_between(before, drawn)
        return np.asarray(drawn[_first(depth, self.sampler.prior.penetration)])

    def depth_between(self, before: Array, after: Array) -> Array:
        """The penetration (N,) of fingers in mm on the way from one pose (D,) to others (N, D)."""
        way = before + np.linspace(0, 1, ON_THE_WAY + 1)[1:, None, None] * (after - before)
        whole = np.zeros((way[..., 0].size, len(self.person.surface.whole.initial)))
        whole[:, : way.shape[-1]] = way.reshape(len(whole), -1)
        return np.asarray(self.person.penetration_mm(whole).reshape(len(way), -1).max(axis=0))

    def palm(self, before: Rotation | None, facing: float = 1.0) -> tuple[Rotation, Array]:
        """A palm rotation and the inputs of its forearm, such that the arm can be that of a person at the camera.

        before  the palm rotation to start from, if there is one
        facing  factor of pitch and yaw
        """
        sampler, surface = self.sampler, self.sampler.surface
        own = len(sampler.skeleton.initial)
        palms = Rotation.from_euler("ZXY", sampler.rotations(self.rng, CANDIDATES) * (1, facing, -facing))
        free = own + np.flatnonzero(~surface.whole.fixed[own:])
        arms = np.zeros((CANDIDATES, len(surface.whole.initial)))
        arms[:, free] = ARM_DEVIATION * surface.deviation[free] * self.rng.standard_normal((CANDIDATES, len(free)))
        arms = np.clip(arms, surface.whole.lower, surface.whole.upper)[:, own:]
        chosen = _first(self._strain(before, palms, arms), 0.0)
        return palms[chosen], arms[chosen]

    def _strain(self, before: Rotation | None, palms: Rotation, arms: Array) -> Array:
        """The implausibility (N,) of palms and forearms, also on the way; 0 is plausible."""
        surface, count = self.sampler.surface, len(arms)
        steps = np.zeros((count, 3)) if before is None else (before.inv() * palms).as_rotvec()
        over = np.zeros(count)
        for left in (0.0, 0.5):
            way = palms * Rotation.from_rotvec(-left * steps)
            none = np.zeros((count, len(self.sampler.skeleton.initial)))
            ends = self.person.ends(posed(self.sampler, self.person, none, way, arms))
            limb = (ends[:, surface.end[surface.limbs]] - ends[:, surface.start[surface.limbs]])[:, 0]
            limb = limb / np.linalg.norm(limb, axis=1, keepdims=True) * mirror_of(self.side)
            x, y, z = limb.T
            too_far = np.stack([-z - TOWARDS, y - UPWARDS, -x * self.outward - INWARDS])
            over = np.maximum(over, np.maximum(too_far, 0).sum(axis=0))
        return np.asarray(over + np.maximum(np.linalg.norm(steps, axis=1) - MAX_TURN, 0))


def _first(found: Array, most: float) -> int:
    """The index of the first value within the bound, otherwise of the lowest."""
    possible = np.flatnonzero(found <= most)
    return int(possible[0] if len(possible) else found.argmin())
