"""Distribution of body surfaces: thickness, limbs and sleeves, and capsules drawn from it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from handpose.body.capsules import Capsules, in_front, joined
from handpose.body.model import Surface
from handpose.synthetic.pose_prior import Bodies, cut_normal, draw_again
from netlib.blob import Array


@dataclass(frozen=True)
class SurfacePrior:
    """The variation of surfaces about the skeleton file's.

    A limb is a part of the surface alone, such as an arm.
    """

    thickness_mean: float = 1.0  # normal: all radii of a body together, relative to its size
    thickness_std: float = 0.08
    # normal: additional scale of the radii of capsules that only the root moves
    trunk_mean: float = 1.0
    trunk_std: float = 0.0
    radius_std: float = 0.0  # normal: each radius independently
    clip: float = 2.5  # all are clipped at this many standard deviations
    # uniform: factor of the file's offsets of capsules from their joints
    offsets: tuple[float, float] = (1.0, 1.0)
    limb: tuple[float, float] = (1.0, 1.0)  # uniform: radii of limbs, of the file's
    # maximum component of a limb's direction towards the camera
    towards_camera: float = 0.35
    redraws: int = 12  # maximum number of further draws of a limb's angles for it
    redraw_wider: float = 3.0  # factor of the file's deviations that the last draw reaches
    cut: float = 0.0  # fraction of limbs that end early (outside the image, or masked)
    cut_at: tuple[float, float] = (0.1, 0.9)  # uniform: the fraction of their length where they do
    sleeve: float = 0.0  # fraction of limbs with a sleeve
    sleeve_from: tuple[float, float] = (0.0, 0.5)  # uniform: fraction of the length where it starts
    sleeve_mm: tuple[float, float] = (2.0, 15.0)  # uniform: additional thickness


DEFAULT_SURFACE = SurfacePrior()
# People in front of a camera.
PERSON_SURFACE = SurfacePrior(
    radius_std=0.05, offsets=(0.6, 1.4), limb=(0.75, 1.1), towards_camera=0.5, cut=0.3, sleeve=0.4
)


def draw_capsules(
    rng: np.random.Generator,
    prior: SurfacePrior,
    surface: Surface,
    bodies: Bodies,
    unit_mm: float,
    origin: Array,
) -> Capsules:
    """The capsules of N bodies and their limbs, in mm, camera axes.

    bodies   N bodies, of which the DoFs of the surface alone are still to be drawn
    unit_mm  length unit
    origin   (N, 3) mm, origin of the inputs
    """
    N = len(bodies.scale)
    offset = rng.uniform(*prior.offsets, N)
    ends = _draw_ends(rng, prior, surface, bodies, offset)
    radii = _draw_radii(rng, prior, surface, bodies.scale) * unit_mm
    a = origin[:, None] + ends[:, surface.start] * unit_mm
    b = origin[:, None] + ends[:, surface.end] * unit_mm
    body = Capsules(a, b, radii[..., 0], radii[..., 1], surface.facets)
    length = np.where(rng.random(N) < prior.cut, rng.uniform(*prior.cut_at, N), 1.0)
    limbs = body.chosen(surface.limbs).part(np.zeros((N, 1)), length[:, None])
    for values, own in zip(body[:4], limbs[:4]):
        values[:, surface.limbs] = own
    sleeves = _draw_sleeves(rng, prior, limbs)
    return in_front(joined([body, sleeves]) if prior.sleeve else body)


def _draw_sleeves(rng: np.random.Generator, prior: SurfacePrior, limbs: Capsules) -> Capsules:
    """The sleeves of limbs; where there is none, the limb itself once more."""
    N = len(limbs.a)
    has_sleeve = rng.random(N) < prior.sleeve
    start = rng.uniform(*prior.sleeve_from, N) * has_sleeve
    thickness_mm = np.where(has_sleeve, rng.uniform(*prior.sleeve_mm, N), 0.0)[:, None]
    ra, rb = limbs.radius_a + thickness_mm, limbs.radius_b + thickness_mm
    return limbs._replace(radius_a=ra, radius_b=rb).part(start[:, None], np.ones((N, 1)))


def _draw_radii(
    rng: np.random.Generator, prior: SurfacePrior, surface: Surface, scale: Array
) -> Array:
    """The radii (N, M, 2) of bodies of these sizes (N,)."""
    N = len(scale)
    thickness = cut_normal(rng, prior.thickness_mean, prior.thickness_std, (N,), prior.clip)
    radii = surface.radii * (scale * thickness)[:, None, None]
    if (prior.trunk_mean, prior.trunk_std) != (1.0, 0.0):
        trunk = cut_normal(rng, prior.trunk_mean, prior.trunk_std, (N, 1, 1), prior.clip)
        radii[:, surface.trunk] *= trunk
    if prior.radius_std:
        radii *= cut_normal(rng, 1, prior.radius_std, radii.shape, prior.clip)
    radii[:, surface.limbs] *= rng.uniform(*prior.limb, (N, 1, 1))
    return radii


def _draw_ends(
    rng: np.random.Generator, prior: SurfacePrior, surface: Surface, bodies: Bodies, offset: Array
) -> Array:
    """The capsules' ends (N, K, 3) with limbs that do not point at the camera; of the draw in
    which they do so least, if they do in all.

    offset  (N,) factor of the file's offsets of capsules from their joints
    """
    whole = surface.whole
    own = len(surface.skeleton.initial)
    free = own + np.flatnonzero(~whole.fixed[own:] & np.isfinite(surface.deviation[own:]))
    N = len(offset)
    inputs = np.zeros((N, len(whole.initial)))
    inputs[:, :own] = bodies.inputs
    best = np.zeros((N, len(whole.joint_names), 3))

    def trial(todo: NDArray[np.int_], factor: float) -> tuple[Array, Array]:
        trials = inputs[todo]
        drawn = factor * surface.deviation[free] * rng.standard_normal((len(todo), len(free)))
        trials[:, free] = np.clip(drawn, whole.lower[free], whole.upper[free])
        pose = surface.kinematics.forward(trials, bodies.bones[todo])
        ends = surface.ends(pose, bodies.scale[todo], offset[todo])
        return ends, _towards_camera(surface, ends)

    factors = np.linspace(1, prior.redraw_wider, 1 + prior.redraws)
    draw_again(best, prior.towards_camera, trial, factors)
    return best


def _towards_camera(surface: Surface, ends: Array) -> Array:
    """The largest component (N,) of the limbs' directions towards the camera; -1 without limbs."""
    limb = ends[:, surface.end[surface.limbs]] - ends[:, surface.start[surface.limbs]]
    component = -limb[..., 2] / np.linalg.norm(limb, axis=-1)
    return component.max(axis=1, initial=-1.0)
