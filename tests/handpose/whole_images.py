"""Whole depth images of hands, for tests of functions that process crops."""

from __future__ import annotations

import numpy as np

from handpose.body.nyu import CUBE_MM
from handpose.body.render import Capsules, Floats, render
from handpose.frames.cameras import NYU, Camera
from handpose.synthetic.pose_prior import Bodies, BodySampler
from handpose.synthetic.surface_prior import DEFAULT_SURFACE, SurfacePrior, draw_capsules

ARM_BEHIND = SurfacePrior(towards_camera=-0.2)  # the hand is nearer than the arm, as when held towards the camera


def render_image(capsules: Capsules, camera: Camera = NYU, background: float = np.inf) -> Floats:
    """Depth (N, height, width) in mm of the whole image; ``background`` where there is no capsule."""
    N = len(capsules.a)
    x = np.broadcast_to((np.arange(camera.width) - camera.u0) / camera.fx, (N, camera.width))
    y = np.broadcast_to((np.arange(camera.height) - camera.v0) / camera.fy, (N, camera.height))
    return render(capsules, x, y, np.full(N, background))


def capsules_of(
    sampler: BodySampler,
    rng: np.random.Generator,
    hands: Bodies,
    center_mm: object,
    prior: SurfacePrior = DEFAULT_SURFACE,
) -> Capsules:
    """Capsules in mm of hands whose crop centres (N, 3) or (3,) are given in mm."""
    center = np.broadcast_to(np.asarray(center_mm, float), (len(hands.joints), 3))
    return draw_capsules(rng, prior, sampler.surface, hands.inputs, hands.bones, hands.scale, CUBE_MM / 2, center)
