"""Capsules of drawn hands, for tests of functions that process crops."""

from __future__ import annotations

import numpy as np

from handpose.body.capsules import Capsules
from handpose.body.nyu import CUBE_MM
from handpose.synthetic.pose_prior import Bodies, BodySampler
from handpose.synthetic.surface_prior import DEFAULT_SURFACE, SurfacePrior, draw_capsules

# the hand is nearer than the arm, as when held towards the camera
ARM_BEHIND = SurfacePrior(towards_camera=-0.2)


def capsules_of(
    sampler: BodySampler,
    rng: np.random.Generator,
    hands: Bodies,
    center_mm: object,
    prior: SurfacePrior = DEFAULT_SURFACE,
) -> Capsules:
    """Capsules in mm of hands whose crop centres (N, 3) or (3,) are given in mm."""
    center = np.broadcast_to(np.asarray(center_mm, float), (len(hands.joints), 3))
    return draw_capsules(rng, prior, sampler.surface, hands, CUBE_MM / 2, center)
