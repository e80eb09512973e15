"""Residuals of the observed depth: of points on the surface, of the silhouette, and of free space.

Points. The nearest point to p on a capsule's axis is c(s) = a + s (b - a), with the radius r(s). The point should have
that distance, on the side that faces the camera. With the ray v through the point and y = p - c,

    f = max(y . v, 0)         how far the point is behind the axis, along the ray
    rho = |y - f v|           its distance from the axis across the ray

A point on the facing side has f = 0 and the residual |y| - r. A point behind cannot be seen there. The nearest visible
point is on the capsule's outline, at rho - r across the ray and f along it (Tagliasacchi et al., Robust Articulated-ICP
for Real-Time Hand Tracking, 2015). Both are residuals, and both are 0 on the surface.

Spheres. Surface points attract capsules to observed depth, but do not keep a limb out of empty space. Spheres along the
capsules' axes do. A sphere of radius r at c, which projects to (column, row) of the crop,

    leaves the silhouette by            F(column, row) z / z_0 + r       F: mm outside, at the centre's depth
    is in front of the surface by       nearest(column, row) - (z - r)

Each is a residual where it exceeds a slack, otherwise 0. F is interpolated between pixels, and so is its slope.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from handpose.fit.body import CapsuleModel
from handpose.fit.observation import BACKGROUND, Floats, Observation
from handpose.fit.residuals import Cones, Residuals, belonging

_TINY = np.float32(1e-6)
POSITION_BITS = 11  # bits of a position of half the cube's edge: 1/8 mm for a hand
DIRECTION_STEP = np.float32(2.0**-10)

PLACES = (1.0,)  # positions of the spheres on each capsule's axis; another one in the middle improves nothing


def nearest_capsules(cones: Cones, seen: Observation) -> NDArray[np.int_]:
    """The capsule (N, P) nearest to every point, on its facing side, by an approximation.

    All capsules are compared with all points, so the nearest point of the axis is computed as if both radii were equal.
    The parts that are linear in the points come from two matrix products; with t the position on the axis in mm,

        t = clip((p - a) . d)        |y|² = |p - a|² - t (2 (p - a) . d - t)        f = (p - a) . v - t d . v

    Positions are rounded to about 0.1 mm and directions to 0.001. All products and their sums are then exact in
    float32, so the result does not depend on the order in which a processor sums.
    """
    mm = np.ldexp(np.float32(1), np.frexp(seen.half)[1] - POSITION_BITS)[:, None, None]
    p, v, a = _on_grid(seen.points, mm), _on_grid(seen.rays, DIRECTION_STEP), _on_grid(cones.a, mm)
    N, _, P = p.shape
    M = a.shape[2]
    length = np.sqrt((cones.along * cones.along).sum(axis=1)) + _TINY
    d = _on_grid(cones.along / length[:, None], DIRECTION_STEP)
    ones = np.ones((N, 1, P), np.float32)
    rows = np.empty((N, 2 * M, 5), np.float32)
    rows[:, :M, :3], rows[:, :M, 3], rows[:, :M, 4] = d.swapaxes(1, 2), -(a * d).sum(axis=1), 0
    rows[:, M:, :3], rows[:, M:, 3], rows[:, M:, 4] = -2 * a.swapaxes(1, 2), (a * a).sum(axis=1), 1
    both = rows @ np.concatenate([p, ones, (p * p).sum(axis=1, keepdims=True)], axis=1)
    along, across = both[:, :M], both[:, M:]
    rows[:, :M, 3], rows[:, M:, :3], rows[:, M:, 3] = 0, -a.swapaxes(1, 2), 1
    both = rows[:, :, :4] @ np.concatenate([v, (p * v).sum(axis=1, keepdims=True)], axis=1)
    away, behind = both[:, :M], both[:, M:]
    t = np.maximum(along, 0)
    np.minimum(t, length[..., None], out=t)
    along += along
    along -= t
    along *= t
    across -= along  # |y|²
    away *= t
    behind -= away
    np.maximum(behind, 0, out=behind)
    behind *= behind  # f²
    across -= behind
    np.maximum(across, 0, out=across)
    np.sqrt(across, out=across)  # rho
    t *= (cones.wider / length)[..., None]
    across -= t
    across -= cones.radius[..., None]
    across *= across
    across += behind
    return across.argmin(axis=1)


def _on_grid(values: Floats, step: np.float32 | Floats) -> Floats:
    """The nearest multiples of a power of two."""
    on_grid = values / step
    np.rint(on_grid, out=on_grid)
    on_grid *= step
    return on_grid


def point_residuals(cones: Cones, seen: Observation, capsule: NDArray[np.int_]) -> Residuals:
    """The residuals rho - r and f of each point on its capsule (N, P).

    Where the radii differ, the nearest point of the axis is shifted towards the thinner end, so that the surface's
    normal through it meets p.
    """
    N, P = capsule.shape
    own = cones.of(belonging(capsule, cones.a.shape[2]))
    q, w = seen.points - own.a, own.wider
    LL, t = np.maximum((own.along * own.along).sum(axis=1), _TINY), (q * own.along).sum(axis=1)
    h = np.sqrt(np.maximum((q * q).sum(axis=1) * LL - t * t, 0))
    s = (t + h * w / np.sqrt(np.maximum(LL - w * w, 1e-3))) / LL
    np.maximum(s, 0, out=s)
    np.minimum(s, 1, out=s)
    c, radius = own.at(s)
    y = seen.points - c
    f = np.maximum((y * seen.rays).sum(axis=1), 0)
    y -= f[:, None] * seen.rays
    rho = np.sqrt((y * y).sum(axis=1)) + _TINY
    direction, swell, value = (np.zeros((N, *shape, P), np.float32) for shape in ((3, 2), (2,), (2,)))
    np.divide(y, -rho[:, None], out=direction[:, :, 0])
    np.multiply(seen.rays, -(f > 0).astype(np.float32)[:, None], out=direction[:, :, 1])
    np.negative(radius, out=swell[:, 0])
    np.subtract(rho, radius, out=value[:, 0])
    value[:, 1] = f
    return Residuals(capsule, s, direction, swell, value)


def spheres_of(model: CapsuleModel) -> tuple[NDArray[np.int_], Floats]:
    """The capsule of each sphere and its position on the axis, for all capsules of the skeleton's own joints."""
    own = np.flatnonzero(~model.surface.limbs)
    return np.repeat(own, len(PLACES)), np.tile(np.array(PLACES, np.float32), len(own))


def sphere_residuals(
    cones: Cones, seen: Observation, spheres: tuple[NDArray[np.int_], Floats], slack: float
) -> Residuals:
    """Distances in mm by which each sphere leaves the silhouette, and by which it is in front of the surface.

    cones    of all M capsules
    spheres  the capsule of each sphere (R,), and its position on the axis (R,)
    slack    mm that are allowed
    """
    N, S, R = len(cones.a), seen.outside.shape[-1], len(spheres[0])
    capsule, place = np.broadcast_to(spheres[0], (N, R)), np.broadcast_to(spheres[1], (N, R))
    c, radius = Cones(*(values[..., spheres[0]] for values in cones)).at(place)
    at = c + seen.center[:, :, None]
    z, far = at[:, 2], seen.center[:, 2:]
    pixel = seen.factor[:, :, None] * at[:, :2] / z[:, None]  # per column and per row
    pixel += seen.offset[:, :, None]
    shown = ((pixel >= 0) & (pixel < S - 1)).all(axis=1) & (z > 0)
    pixel = np.where(shown[:, None], pixel, 0)
    corner = pixel.astype(np.int64)
    right, down = (pixel - corner).swapaxes(0, 1)
    crop = seen.frame[:, None] * (S * S)
    first = corner[:, 1] * S + corner[:, 0] + crop
    F = seen.outside.reshape(-1)[first + np.array([0, 1, S, S + 1])[:, None, None]]
    across_upper, across_lower = F[1] - F[0], F[3] - F[2]
    upper, lower = F[0] + right * across_upper, F[2] + right * across_lower
    falls = lower - upper
    outside = upper + down * falls
    slopes = np.stack([across_upper + down * (across_lower - across_upper), falls], axis=1)

    # F is measured at the centre's depth, so F z / z_0 is used, and a pixel there is z / factor mm.
    slopes *= seen.factor[:, :, None] / far[:, None]
    direction = np.zeros((N, 3, 2, R), np.float32)
    direction[:, :2, 0] = slopes
    direction[:, 2, 0] = outside / far - (slopes * at[:, :2]).sum(axis=1) / z
    direction[:, 2, 1] = -1
    column, row = np.rint(pixel).astype(np.int64).swapaxes(0, 1)
    surface = seen.nearest.reshape(-1)[row * S + column + crop]
    value = np.stack([outside * z / far + radius, surface - c[:, 2] + radius], axis=1)
    value -= np.float32(slack)
    active = value > 0
    active &= shown[:, None]
    active[:, 1] &= surface < BACKGROUND * seen.half[:, None]
    on = active.astype(np.float32)
    value *= on  # inactive residuals are 0, with derivative 0
    direction *= on[:, None]
    return Residuals(capsule, place, direction, radius[:, None] * on, value)
