"""Distribution of body surfaces: thickness, limbs and sleeves, and capsules drawn from it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from handpose.body.model import Surface
from handpose.body.render import NO_FACETS, Capsules, in_front, joined
from handpose.synthetic.pose_prior import Bodies, cut_normal
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
    # maximum component of a limb's direction towards the camera, otherwise ...
    towards_camera: float = 0.35
    # ... its angles are drawn again this many times, from the file's deviations to ...
    redraws: int = 12
    redraw_wider: float = 3.0  # ... this factor of those; the best of all draws is kept
    cut: float = 0.0  # this fraction of limbs ends early (outside the image, or masked) ...
    cut_at: tuple[float, float] = (0.1, 0.9)  # ... uniform: at this part of its length
    sleeve: float = 0.0  # this fraction of limbs wears one ...
    sleeve_from: tuple[float, float] = (0.0, 0.5)  # ... uniform: from this part of its length on
    sleeve_mm: tuple[float, float] = (2.0, 15.0)  # ... uniform: additional thickness


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

    bodies   whose DoFs of the surface alone are drawn
    unit_mm  length unit
    origin   (N, 3) mm, origin of the inputs
    """
    N = len(bodies.scale)
    offset = rng.uniform(*prior.offsets, N)
    ends = _least_towards_camera(rng, prior, surface, bodies, offset)
    radii = _draw_radii(rng, prior, surface, bodies.scale) * unit_mm
    a = origin[:, None] + ends[:, surface.start] * unit_mm
    b = origin[:, None] + ends[:, surface.end] * unit_mm
    cut = np.where(rng.random(N) < prior.cut, rng.uniform(*prior.cut_at, N), 1.0)
    worn = rng.random(N) < prior.sleeve
    sleeve_from = rng.uniform(*prior.sleeve_from, N)
    thicker = np.where(worn, rng.uniform(*prior.sleeve_mm, N), 0.0)
    sleeves = []
    for m in np.flatnonzero(surface.limbs):
        start, end, r = a[:, m], b[:, m], radii[:, m]  # views
        start[:], end[:], r[:] = _piece(start, end, r, np.zeros(N), cut)
        if prior.sleeve:  # bodies without one have a second arm in the same place
            sleeve = r + thicker[:, None]
            piece = _piece(start, end, sleeve, sleeve_from * worn, np.ones(N))
            sleeves.append(_capsules(*(values[:, None] for values in piece)))
    return in_front(joined([_capsules(a, b, radii, surface.facets), *sleeves]))


def _draw_radii(
    rng: np.random.Generator, prior: SurfacePrior, surface: Surface, scale: Array
) -> Array:
    """The radii (N, M, 2) of bodies of these sizes (N,)."""
    N, M = len(scale), len(surface.radii)
    thickness = prior.thickness_mean + prior.thickness_std * cut_normal(rng, (N,), prior.clip)
    radii = surface.radii * (scale * thickness)[:, None, None]
    if (prior.trunk_mean, prior.trunk_std) != (1.0, 0.0):
        thicker = prior.trunk_mean + prior.trunk_std * cut_normal(rng, (N, 1, 1), prior.clip)
        radii[:, surface.trunk] *= thicker
    if prior.radius_std:
        radii *= 1 + prior.radius_std * cut_normal(rng, (N, M, 2), prior.clip)
    radii[:, surface.limbs] *= rng.uniform(*prior.limb, (N, 1, 1))
    return radii


def _capsules(a: Array, b: Array, radii: Array, facets: NDArray[np.int_] = NO_FACETS) -> Capsules:
    """The capsules with radii (N, M, 2)."""
    return Capsules(a, b, radii[:, :, 0], radii[:, :, 1], facets)


def _least_towards_camera(
    rng: np.random.Generator, prior: SurfacePrior, surface: Surface, bodies: Bodies, offset: Array
) -> Array:
    """Ends (N, K, 3) with drawn limbs: of the first draw that does not point at the
    camera, or the best.
    """
    whole = surface.whole
    own = len(surface.skeleton.initial)
    free = own + np.flatnonzero(~whole.fixed[own:] & np.isfinite(surface.deviation[own:]))
    N = len(offset)
    posed = np.zeros((N, len(whole.initial)))
    posed[:, :own] = bodies.inputs
    least = np.full(N, np.inf)
    best = np.zeros((N, len(whole.joint_names), 3))
    todo = np.arange(N)
    for wider in np.linspace(1, prior.redraw_wider, 1 + prior.redraws):
        trial = posed[todo]
        drawn = wider * surface.deviation[free] * rng.standard_normal((len(todo), len(free)))
        trial[:, free] = np.clip(drawn, whole.lower[free], whole.upper[free])
        pose = surface.kinematics.forward(trial, bodies.bones[todo])
        ends = surface.ends(pose, bodies.scale[todo], offset[todo])
        limb = ends[:, surface.end[surface.limbs]] - ends[:, surface.start[surface.limbs]]
        cosines = -limb[..., 2] / np.linalg.norm(limb, axis=-1)
        towards = cosines.max(axis=1, initial=-1.0)
        better = towards < least[todo]
        best[todo[better]], least[todo[better]] = ends[better], towards[better]
        todo = np.flatnonzero(least > prior.towards_camera)
        if not len(todo):
            break
    return best


def _piece(
    a: Array, b: Array, radii: Array, first: Array, last: Array
) -> tuple[Array, Array, Array]:
    """The capsule (N, 3), (N, 3), (N, 2) from the part ``first`` (N,) of its length to the
    part ``last``.
    """
    along, wider = b - a, radii[:, 1] - radii[:, 0]
    start = a + first[:, None] * along
    end = a + last[:, None] * along
    at_start = radii[:, 0] + first * wider
    at_end = radii[:, 0] + last * wider
    return start, end, np.stack([at_start, at_end], axis=1)
