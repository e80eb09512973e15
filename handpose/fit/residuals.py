r"""Residuals of the observed depth: of the surface, the silhouette and free space; and their
normal equations.

Points. The nearest point to p on a capsule's axis is c(s) = a + s (b - a), with the radius r(s).
The point should have that distance, on the side that faces the camera. With the ray v through the
point and y = p - c,

    f = max(y . v, 0)         how far the point is behind the axis, along the ray
    rho = |y - f v|           its distance from the axis across the ray

A point on the facing side has f = 0 and the residual |y| - r. A point behind cannot be seen there.
The nearest visible point is on the capsule's outline, at rho - r across the ray and f along it
(Tagliasacchi et al., Robust Articulated-ICP for Real-Time Hand Tracking, 2015). Both are residuals,
and both are 0 on the surface.

Spheres. Surface points attract capsules to observed depth, but do not keep a limb out of empty
space. Spheres at the capsules' ends do. A sphere of radius r at c, which projects to
(column, row) of the crop,

    leaves the silhouette by        F(column, row) z / z_0 + r, with F in mm at the centre's depth
    is in front of the surface by   nearest(column, row) - (z - r)

Each is a residual where it exceeds a slack, otherwise 0. F is interpolated between pixels, and
so is its slope.

Normal equations. A residual r measures one point of the body along one direction u. With
c = (1 - s) E_i + s E_j the point at the place s of a capsule's axis,

    dr / dx  =  (1 - s) u . dE_i/dx  +  s u . dE_j/dx  +  w d log radius / dx
    z = ((1 - s) u, s u, w)

where w is the contribution of the radius as the body gets thicker. So each residual needs 8
numbers: z and r itself. Their weighted products, summed for each capsule to an 8 x 8 matrix G_m,
determine the normal equations:

    A  =  sum over capsules of  B_m^T G_m B_m
    B_m = (dE_i/dx; dE_j/dx; 1 for size and thickness), 7 x V
    b  =  sum over capsules of  B_m^T g_m            g_m the last column of G_m

There are several hundred residuals, but few capsules: this takes a third of the time of the full
Jacobian. Every point has two residuals, which share its capsule and place.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from handpose.fit.body import SIZE_INDEX, THICKNESS_INDEX, CapsuleModel, Posed
from handpose.fit.observation import Observation
from handpose.frames.cameras import Floats
from handpose.frames.crops import FAR_FACE
from netlib.blob import Array

_TINY = np.float32(1e-6)  # mm or mm², where a division by 0 would occur
_MIN_SIDE_MM2 = 1e-3  # one of two spheres may contain the other
POSITION_BITS = 11  # bits of a position of half the cube's edge: 1/8 mm for a hand
DIRECTION_STEP = np.float32(2.0**-10)
_UPPER = np.triu_indices(8)  # the 36 independent elements of a symmetric 8 x 8 matrix
_DIAGONAL = np.flatnonzero(_UPPER[0] == _UPPER[1])
_FULL = np.zeros((8, 8), int)  # for each of the 64 elements, its index among the 36
_FULL[_UPPER] = _FULL.T[_UPPER] = np.arange(36)


class Residuals(NamedTuple):
    """Two residuals for each of R points in N frames, in mm.

    Points come last, so the innermost loops are long.
    """

    capsule: NDArray[np.int_]  # (N, R)
    place: Floats  # (N, R) position on the capsule's axis, 0 to 1
    direction: Floats  # (N, 3, 2, R): derivatives of the residuals by the point's position
    swell: Floats  # (N, 2, R): derivatives by the logarithm of the radii
    value: Floats  # (N, 2, R)


class Cones(NamedTuple):
    """R capsules: all of a body, or one for each point. In mm."""

    a: Floats  # (N, 3, R) start of the axis
    along: Floats  # (N, 3, R) end minus start
    radius: Floats  # (N, R) at its start
    wider: Floats  # (N, R) radius at the end minus radius at the start

    def at(self, place: Floats) -> tuple[Floats, Floats]:
        """The points (N, 3, R) at positions (N, R) on the axes, and the radii (N, R) there."""
        return self.a + place[:, None] * self.along, self.radius + place * self.wider

    def of(self, belongs: Floats) -> Cones:
        """The capsules of the points given by ``belonging``; a product is faster than indexing."""
        columns = [self.a, self.along, self.radius[:, None], self.wider[:, None]]
        own = np.concatenate(columns, axis=1) @ belongs
        radius, wider = own[:, 6], own[:, 7]
        return Cones(own[:, :3], own[:, 3:6], radius, wider)


def cones_of(model: CapsuleModel, posed: Posed) -> Cones:
    """All M capsules."""
    ends = posed.ends.swapaxes(1, 2)
    a = ends[:, :, model.start]
    radii = model.radii.T * posed.thickness[:, None, None]
    along = ends[:, :, model.end] - a
    return Cones(a, along, radii[:, 0], radii[:, 1] - radii[:, 0])


def belonging(capsule: NDArray[np.int_], capsules: int) -> Floats:
    """(N, M, R): 1 where a point (N, R) is one of a capsule, else 0."""
    return np.equal(capsule[:, None], np.arange(capsules)[:, None]).astype(np.float32)


def residuals_of(
    model: CapsuleModel, posed: Posed, seen: Observation, spheres: NDArray[np.int_], slack: float
) -> Residuals:
    """The residuals of all points, each on its nearest capsule, and then of the spheres
    (``sphere_residuals``).
    """
    cones = cones_of(model, posed)
    points = point_residuals(cones, seen, nearest_capsules(cones, seen))
    others = sphere_residuals(cones, seen, spheres, slack)
    return Residuals(*(np.concatenate([a, b], axis=-1) for a, b in zip(points, others)))


def nearest_capsules(cones: Cones, seen: Observation) -> NDArray[np.int_]:
    """The capsule (N, P) nearest to every point, on its facing side, by an approximation.

    All capsules are compared with all points, so the nearest point of the axis is computed as if
    both radii were equal. The parts that are linear in the points come from two matrix products;
    with t the position on the axis in mm,

        t = clip((p - a) . d)        |y|² = |p - a|² - t (2 (p - a) . d - t)
        f = (p - a) . v - t d . v

    Positions are rounded to about 0.1 mm and directions to 0.001. All products and their sums are
    then exact in float32, so the result does not depend on the order in which a processor sums.
    """
    step = np.ldexp(np.float32(1), np.frexp(seen.half)[1] - POSITION_BITS)[:, None, None]
    p, a = _on_grid(seen.points, step), _on_grid(cones.a, step)
    v = _on_grid(seen.rays, DIRECTION_STEP)
    length = np.sqrt((cones.along * cones.along).sum(axis=1)) + _TINY
    d = _on_grid(cones.along / length[:, None], DIRECTION_STEP)
    pa_d, pa_pa, d_v, pa_v = _point_products(p, v, a, d)
    t = np.maximum(pa_d, 0)
    np.minimum(t, length[..., None], out=t)
    # New arrays would take longer than the arithmetic, so all results are in those at hand.
    pa_d += pa_d
    pa_d -= t
    pa_d *= t
    y_y = np.subtract(pa_pa, pa_d, out=pa_pa)
    d_v *= t
    f = np.subtract(pa_v, d_v, out=pa_v)
    np.maximum(f, 0, out=f)
    f_f = np.square(f, out=f)
    rho = np.subtract(y_y, f_f, out=y_y)
    np.maximum(rho, 0, out=rho)
    np.sqrt(rho, out=rho)
    t *= (cones.wider / length)[..., None]
    rho -= t
    rho -= cones.radius[..., None]
    rho *= rho
    rho += f_f  # the squared residuals of the point
    return rho.argmin(axis=1)


def _point_products(p: Floats, v: Floats, a: Floats, d: Floats) -> list[Floats]:
    """The products (p - a) . d, |p - a|², d . v and (p - a) . v, (N, M, P) each, of points and
    rays p, v (N, 3, P) and axes a, d (N, 3, M).
    """
    N, _, P = p.shape
    M = a.shape[2]
    ones = np.ones((N, 1, P), np.float32)
    rows = np.empty((N, 2 * M, 5), np.float32)
    upper, lower = rows[:, :M], rows[:, M:]
    # the first two, from the columns (p, 1, |p|²)
    upper[:, :, :3] = d.swapaxes(1, 2)
    upper[:, :, 3] = -(a * d).sum(axis=1)
    upper[:, :, 4] = 0
    lower[:, :, :3] = -2 * a.swapaxes(1, 2)
    lower[:, :, 3] = (a * a).sum(axis=1)
    lower[:, :, 4] = 1
    of_points = rows @ np.concatenate([p, ones, (p * p).sum(axis=1, keepdims=True)], axis=1)
    # the last two, from the columns (v, p . v)
    upper[:, :, 3] = 0
    lower[:, :, :3] = -a.swapaxes(1, 2)
    lower[:, :, 3] = 1
    columns = np.concatenate([v, (p * v).sum(axis=1, keepdims=True)], axis=1)
    of_rays = rows[:, :, :4] @ columns
    return [*np.split(of_points, 2, axis=1), *np.split(of_rays, 2, axis=1)]


def _on_grid(values: Floats, step: np.float32 | Floats) -> Floats:
    """The nearest multiples of a power of two."""
    on_grid = values / step
    np.rint(on_grid, out=on_grid)
    on_grid *= step
    return on_grid


def point_residuals(cones: Cones, seen: Observation, capsule: NDArray[np.int_]) -> Residuals:
    """The residuals rho - r and f of each point on its capsule (N, P).

    Where the radii differ, the nearest point of the axis is shifted towards the thinner end, so
    that the surface's normal through it meets p.
    """
    N, P = capsule.shape
    own = cones.of(belonging(capsule, cones.a.shape[2]))
    q = seen.points - own.a
    w = own.wider
    LL = np.maximum((own.along * own.along).sum(axis=1), _TINY)
    qq, t = (q * q).sum(axis=1), (q * own.along).sum(axis=1)
    h = np.sqrt(np.maximum(qq * LL - t * t, 0))
    side = np.sqrt(np.maximum(LL - w * w, _MIN_SIDE_MM2))
    s = (t + h * w / side) / LL
    np.maximum(s, 0, out=s)
    np.minimum(s, 1, out=s)
    c, radius = own.at(s)
    y = seen.points - c
    f = np.maximum((y * seen.rays).sum(axis=1), 0)
    y -= f[:, None] * seen.rays
    rho = np.sqrt((y * y).sum(axis=1)) + _TINY
    direction = np.zeros((N, 3, 2, P), np.float32)
    swell, value = np.zeros((2, N, 2, P), np.float32)
    np.divide(y, -rho[:, None], out=direction[:, :, 0])
    is_behind = (f > 0).astype(np.float32)
    np.multiply(seen.rays, -is_behind[:, None], out=direction[:, :, 1])
    np.negative(radius, out=swell[:, 0])
    np.subtract(rho, radius, out=value[:, 0])
    value[:, 1] = f
    return Residuals(capsule, s, direction, swell, value)


def sphere_residuals(
    cones: Cones, seen: Observation, spheres: NDArray[np.int_], slack: float
) -> Residuals:
    """Distances in mm by which each sphere leaves the silhouette, and by which it is in front
    of the surface.

    cones    of all M capsules
    spheres  (R,) the capsules that have a sphere at their end; another one in the middle
             improves nothing
    slack    mm that are allowed
    """
    N, S, R = len(cones.a), seen.outside.shape[-1], len(spheres)
    capsule = np.broadcast_to(spheres, (N, R))
    place = np.ones((N, R), np.float32)
    c, radius = Cones(*(values[..., spheres] for values in cones)).at(place)
    xyz = c + seen.center[:, :, None]
    xy, z = xyz[:, :2], xyz[:, 2]
    center_z = seen.center[:, 2:]
    pixel = seen.factor[:, :, None] * xy / z[:, None]  # column and row
    pixel += seen.offset[:, :, None]
    is_inside = ((pixel >= 0) & (pixel < S - 1)).all(axis=1) & (z > 0)
    pixel = np.where(is_inside[:, None], pixel, 0)
    F, slopes = _interpolated(seen.outside, seen.frame, pixel)
    # F is measured at the centre's depth, so F z / z_0 is used, and a pixel there is z / factor mm.
    slopes *= seen.factor[:, :, None] / center_z[:, None]
    direction = np.zeros((N, 3, 2, R), np.float32)
    direction[:, :2, 0] = slopes
    direction[:, 2, 0] = F / center_z - (slopes * xy).sum(axis=1) / z
    direction[:, 2, 1] = -1
    column, row = np.rint(pixel).astype(np.int64).swapaxes(0, 1)
    surface = seen.nearest[seen.frame[:, None], row, column]
    outside = F * z / center_z + radius
    in_front = surface - c[:, 2] + radius
    value = np.stack([outside, in_front], axis=1)
    value -= np.float32(slack)
    is_active = value > 0
    is_active &= is_inside[:, None]
    is_active[:, 1] &= surface < FAR_FACE * seen.half[:, None]
    active = is_active.astype(np.float32)
    value *= active  # inactive residuals are 0, with derivative 0
    direction *= active[:, None]
    return Residuals(capsule, place, direction, radius[:, None] * active, value)


def _interpolated(images: Floats, frame: NDArray[np.int_], pixel: Floats) -> tuple[Floats, Floats]:
    """The values (N, R) between the pixels of images (.., S, S), and their slopes (N, 2, R) by
    column and row.

    frame  (N,) the image of each row of pixels
    pixel  (N, 2, R) column and row, from 0 to S - 1
    """
    S = images.shape[-1]
    corner = pixel.astype(np.int64)
    right, down = (pixel - corner).swapaxes(0, 1)
    column, row = corner.swapaxes(0, 1)
    first = (frame[:, None] * S + row) * S + column
    neighbours = np.array([0, 1, S, S + 1])
    F = images.reshape(-1)[first + neighbours[:, None, None]]
    upper_slope, lower_slope = F[1] - F[0], F[3] - F[2]
    upper, lower = F[0] + right * upper_slope, F[2] + right * lower_slope
    slope_down = lower - upper
    slope_right = upper_slope + down * (lower_slope - upper_slope)
    return upper + down * slope_down, np.stack([slope_right, slope_down], axis=1)


def normal_equations(
    model: CapsuleModel, posed: Posed, r: Residuals, weight: Floats
) -> tuple[Array, Array]:
    """A (N, V, V) and b (N, V) of the squares weighted by (N, 2, R): half their gradient is b."""
    N, _, R = r.value.shape
    M = len(model.start)
    V = model.variables
    root = np.sqrt(weight)
    z = np.empty((N, 8, 2, R), np.float32)
    np.multiply(r.direction, root[:, None], out=z[:, :3])
    np.multiply(z[:, :3], r.place[:, None, None], out=z[:, 3:6])
    z[:, :3] -= z[:, 3:6]
    np.multiply(r.swell, root, out=z[:, 6])
    np.multiply(r.value, root, out=z[:, 7])
    products = z[:, _UPPER[0]]
    products *= z[:, _UPPER[1]]
    products = products[:, :, 0] + products[:, :, 1]  # (N, 36, R)
    _round_to_exact_sums(products)
    # (N, M, 8, 8)
    G = (belonging(r.capsule, M) @ products.swapaxes(1, 2))[:, :, _FULL].astype(np.float64)
    B = np.zeros((N, M, 7, V))
    B[:, :, :3] = posed.motion[:, model.start]
    B[:, :, 3:6] = posed.motion[:, model.end]
    B[:, :, 6, [SIZE_INDEX, THICKNESS_INDEX]] = 1
    transposed = B.reshape(N, M * 7, V).swapaxes(1, 2)
    A = transposed @ (G[..., :7, :7] @ B).reshape(N, M * 7, V)
    b = transposed @ np.ascontiguousarray(G[..., :7, 7]).reshape(N, M * 7, 1)
    return A, b[..., 0]


def _round_to_exact_sums(products: Floats) -> None:
    """Round products (N, 36, R) of 8 numbers so that every sum along R is exact in
    float32, in any order.

    A processor's BLAS then changes nothing. With T a bound of the sum of absolute values, the
    products become multiples of some T / 2**22: adding and subtracting a number of the size of T
    rounds to them.
    """
    # by Cauchy and Schwarz, T is a product of two of them
    norms = np.sqrt(products[:, _DIAGONAL].sum(axis=2))
    _, exponent = np.frexp(norms[:, _UPPER[0]] * norms[:, _UPPER[1]])
    large = np.ldexp(np.float32(1.5), exponent + 1)[:, :, None]
    products += large
    products -= large
