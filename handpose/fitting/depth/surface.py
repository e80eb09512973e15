r"""The surface: every observed point belongs on a capsule.

Of a point p, the nearest place of a capsule's axis is c(s) = a + s (b - a), with the radius r(s) there. The point
should lie at that distance, on the side that faces the camera. With the ray v through the point and y = p - c,

    f = max(y . v, 0)         how far the point is behind the axis, as the camera looks
    rho = |y - f v|           how far beside it

A point on the facing side has f = 0 and the residual |y| - r. A point behind cannot have been seen there: the nearest
place that could is on the capsule's outline, so that it is off by rho - r sideways and by f along the ray (Tagliasacchi
et al., Robust Articulated-ICP for Real-Time Hand Tracking, 2015). Both are residuals, both are 0 on the surface.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from handpose.fitting.depth.body import FleshModel, Posed
from handpose.fitting.depth.observation import Observation
from handpose.fitting.depth.residuals import Residuals, point_of

_TINY = np.float32(1e-6)


def nearest_capsules(model: FleshModel, posed: Posed, seen: Observation) -> NDArray[np.int_]:
    """For every point the capsule (N, P) on whose facing side it nearly lies.

    All capsules are tried for all points, so the axis' nearest place is taken as if both radii were the same.
    """
    a, b = posed.ends[:, model.start], posed.ends[:, model.end]
    ra, rb = (model.radii[:, k] * posed.girth[:, None] for k in (0, 1))
    D = b - a
    LL = np.maximum((D * D).sum(axis=-1), _TINY)[:, None]
    aT, DT = a.swapaxes(1, 2), D.swapaxes(1, 2)
    p, v = seen.points, seen.rays
    s = p @ DT
    s -= (a * D).sum(axis=-1)[:, None]
    along = s.copy()
    s /= LL
    np.clip(s, 0, 1, out=s)
    along *= 2
    along -= s * LL
    along *= s
    beside = p @ (-2 * aT)  # |y|²
    beside += (p * p).sum(axis=-1)[:, :, None]
    beside += (a * a).sum(axis=-1)[:, None]
    beside -= along
    behind = v @ -aT  # f
    behind += (p * v).sum(axis=-1)[:, :, None]
    behind -= s * (v @ DT)
    np.maximum(behind, 0, out=behind)
    behind *= behind
    beside -= behind
    np.maximum(beside, 0, out=beside)
    np.sqrt(beside, out=beside)  # rho
    s *= (ra - rb)[:, None]
    beside += s
    beside -= ra[:, None]
    beside *= beside
    beside += behind
    return beside.argmin(axis=-1)


def point_residuals(model: FleshModel, posed: Posed, seen: Observation, capsule: NDArray[np.int_]) -> Residuals:
    """rho - r and f of each point on its capsule (N, P).

    Where the radii differ, the nearest place of the axis is so far towards the thinner end that the surface's normal
    points from it to p.
    """
    n = np.arange(len(capsule))[:, None]
    a, b = posed.ends[n, model.start[capsule]], posed.ends[n, model.end[capsule]]
    ra, rb = (model.radii[capsule, k] * posed.girth[:, None] for k in (0, 1))
    D, q, w = b - a, seen.points - a, ra - rb
    LL, t = np.maximum((D * D).sum(axis=-1), _TINY), (q * D).sum(axis=-1)
    h = np.sqrt(np.maximum((q * q).sum(axis=-1) * LL - t * t, 0))
    s = np.clip((t - h * w / np.sqrt(np.maximum(LL - w * w, 1e-3))) / LL, 0, 1)
    c, radius = point_of(model, posed, capsule, s)
    y = seen.points - c
    f = np.maximum((y * seen.rays).sum(axis=-1), 0)
    y -= f[..., None] * seen.rays
    rho = np.sqrt((y * y).sum(axis=-1)) + _TINY
    return Residuals(
        capsule,
        place=s,
        direction=np.stack([y / -rho[..., None], (f > 0)[..., None] * -seen.rays], axis=2),
        swell=np.stack([-radius, np.zeros_like(radius)], axis=2),
        value=np.stack([rho - radius, f], axis=2),
    )
