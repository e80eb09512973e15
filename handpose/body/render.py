r"""Depth images of capsules: a body as a union of round cones, seen by a pinhole camera.

A capsule is the convex hull of two spheres, radii ra at a and rb at b: all the spheres of centre
c(s) = a + s (b - a) and radius r(s) = ra - s (ra - rb), 0 <= s <= 1. A ray t (x, y, 1) has depth t,
so the depth image is the smallest t over all capsules, and the ray meets the sphere s at

    t = (c.d - sqrt((c.d)^2 - d.d (c.c - r^2))) / d.d        with d = (x, y, 1)

Which s it meets first follows from the infinite cone that the spheres touch. With B = b - a,
w = ra - rb, e = B.B - w^2 and g = a.B + ra w, the ray meets that cone at the smaller root of k2
t^2 + 2 k1 t + k0 = 0,

    k2 = e d.d - (B.d)^2      k1 = (g B - e a).d      k0 = e (a.a - ra^2) - g^2
    s = (t B.d - g) / e

and s, limited to [0, 1], is the sphere that holds the first point of the hull. No case distinction
is left for the pixels, so a capsule is twenty array operations on the rectangle of pixels it can
touch; rectangles of similar size, of whatever capsule and frame, go together. B.d, k1, a.d are sums
of a row and a column.

A *wedge* is the convex hull of three spheres: three capsules and, on either side, the triangle in
which the plane that touches all three is touched (``facets``). With the normal n of that plane and
the centres A, B, C

    n.(B - A) = ra - rb     n.(C - A) = ra - rc     |n| = 1
    V = A + ra n, and likewise at B and C

The ray meets the triangle at t = 1 / (f0 + f1 + f2) if no f is negative, where fi is linear in d:
f0 = d.(V1 x V2) / D and so on, D = V0.(V1 x V2).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
from numpy.typing import ArrayLike, NDArray

from handpose.body.capsules import Capsules, in_front
from handpose.frames.cameras import NYU, Array, Camera, Floats
from handpose.frames.crops import SIZE, window
from netlib.errors import DataError

_TILE = 32768  # pixels computed together: half a dozen such arrays stay in the cache
_WIDTH_STEP = 8  # pixels, in which rectangles are sorted by width, and then by height
# tolerance, so that rays along a triangle's border do not miss both it and the capsule
_EDGE = np.float32(1e-4)
_OUTSIDE = 8.0  # slope of the rays of crop pixels outside the image, which meet no capsule


def render_crop(
    capsules: Capsules,
    center_uvd: ArrayLike,
    cube_mm: ArrayLike,
    camera: Camera = NYU,
    size: int = SIZE,
) -> Floats:
    """Depth (N, size, size) in mm, as ``crop`` would cut it from a rendering of the whole image.

    The rays are those of the pixels that ``crop`` picks. Pixels without a surface have the far face
    of the cube; depths outside the cube are not clipped to its faces: see ``normalise_depth``.

    center_uvd  (N, 3) middle of the cubes
    cube_mm     edges of the cubes, one or (N,)
    """
    far = np.atleast_2d(np.asarray(center_uvd, dtype=np.float64))[:, 2] + np.asarray(cube_mm) / 2
    return render(capsules, *crop_rays(center_uvd, cube_mm, camera, size), far)


def crop_rays(
    center_uvd: ArrayLike, cube_mm: ArrayLike, camera: Camera = NYU, size: int = SIZE
) -> tuple[Floats, Floats]:
    """Slopes of the columns (N, size) and of the rows, downwards, of the pixels that ``crop``
    picks; arguments as of ``render_crop``.
    """
    columns, rows = window(center_uvd, cube_mm, camera, size)
    return _slopes(columns, camera.u0, camera.fx), _slopes(rows, camera.v0, camera.fy)


def shown_in_crop(
    capsules: Capsules, center_uvd: Array, cube_mm: float, camera: Camera, size: int = SIZE
) -> Floats:
    """A rendered crop (size, size) in [-1, 1] of one body's capsules about a centre (3,); 1 where
    there is no surface. Parts in front of the cube are not rendered.
    """
    d = center_uvd[2:]
    inside = in_front(capsules, d - cube_mm / 2)
    depth = render_crop(inside, center_uvd[None], cube_mm, camera, size)
    return normalise_depth(depth, d, cube_mm)[0]


def normalise_depth(depth: Floats, center_d: ArrayLike, cube_mm: ArrayLike) -> Floats:
    """Depth (N, H, W) in mm to [-1, 1] across the cubes at depth ``center_d`` (N,), in place."""
    depth -= np.asarray(center_d, dtype=np.float32).reshape(-1, 1, 1)
    depth *= np.asarray(2 / np.asarray(cube_mm), dtype=np.float32).reshape(-1, 1, 1)
    return np.clip(depth, -1, 1, out=depth)


def render(capsules: Capsules, x: ArrayLike, y: ArrayLike, background: ArrayLike) -> Floats:
    """Depth (N, H, W) in mm along the rays of slopes ``x`` (N, W) and ``y`` (N, H), both
    ascending, y DOWN.

    ``background`` (N,) mm is the depth where no capsule is nearer. Raises DataError for a capsule
    that is not in front of the camera.
    """
    x, y = np.asarray(x, dtype=np.float32), np.asarray(y, dtype=np.float32)
    N, M = capsules.radius_a.shape
    image = np.empty((N, y.shape[1], x.shape[1]), dtype=np.float32)
    image[...] = np.asarray(background, dtype=np.float32)[:, None, None]

    a, b, ra, rb = _visible_ends(capsules)
    bounds = [_extent(a, b, ra, rb, axis) for axis in (0, 1)]
    _paint(image, x, y, np.repeat(np.arange(N), M), bounds, _coefficients(a, b, ra, rb), _depths)
    if len(capsules.facets):
        frame, _, corners = _triangles(capsules)
        slopes = corners[:, :, :2] / corners[:, :, 2:]
        bounds = [(slope.min(axis=1), slope.max(axis=1)) for slope in np.moveaxis(slopes, 2, 0)]
        _paint(image, x, y, frame, bounds, _plane_coefficients(corners), _plane_depths)
    return image


def depths_of(capsules: Capsules, x: Floats, y: Floats) -> Floats:
    """Depths (N, M + T, H, W) in mm of the M capsules and then of the T flat parts along the rays
    of slopes ``x`` (N, W) and ``y`` (N, H), y DOWN; infinite where a ray misses one.

    Raises DataError for a capsule that is not in front of the camera.
    """
    N, M = capsules.radius_a.shape
    size = y.shape[1], x.shape[1]
    depths = np.full((N, M + len(capsules.facets), *size), np.inf, np.float32)
    frame = np.repeat(np.arange(N), M)
    coefficients = _coefficients(*_visible_ends(capsules))
    round_parts = _depths(coefficients, x[frame, None, :], y[frame, :, None])
    np.fmin(depths[:, :M], round_parts.reshape(N, M, *size), out=depths[:, :M])
    if len(capsules.facets):
        frame, facet, corners = _triangles(capsules)
        planes = _plane_coefficients(corners)
        flat_parts = _plane_depths(planes, x[frame, None, :], y[frame, :, None])
        for n, t, depth in zip(frame, M + facet, flat_parts):
            np.fmin(depths[n, t], depth, out=depths[n, t])
    return depths


def _paint(
    image: Floats,
    x: Floats,
    y: Floats,
    frame: NDArray[np.int64],
    bounds: list[tuple[Array, Array]],
    coefficients: Floats,
    depths: Callable[[Floats, Floats, Floats], Floats],
) -> None:
    """Draw L shapes into images (N, H, W), where they are nearer than the existing depth.

    frame         (L,) the image of each
    bounds        smallest and largest slope of the rays that meet it, along x and along y
    coefficients  (c, L) of them, for ``depths``, which computes the depths of rays, NaN
                  where they miss
    """
    H, W = image.shape[1:]
    i0, i1 = _pixels(x, frame, *bounds[0])
    j0, j1 = _pixels(y, frame, *bounds[1])
    width, height = i1 - i0, j1 - j0
    shown = np.flatnonzero((width > 0) & (height > 0))
    # similar rectangles together
    steps = -(-width // _WIDTH_STEP)
    shown = shown[np.lexsort((height[shown], steps[shown]))]
    area = (steps * _WIDTH_STEP * height)[shown]
    for filling in _tiles(area):
        some = shown[filling]
        w, h = int(width[some].max()), int(height[some].max())
        column = np.minimum(i0[some], W - w)
        row = np.minimum(j0[some], H - h)
        image_of = frame[some, None]
        across = x[image_of, column[:, None] + np.arange(w)]
        down = y[image_of, row[:, None] + np.arange(h)]
        depth = depths(coefficients[:, some], across[:, None, :], down[:, :, None])
        for n, i, j, tile in zip(
            frame[some].tolist(), column.tolist(), row.tolist(), depth, strict=True
        ):
            part = image[n, j : j + h, i : i + w]
            np.fmin(part, tile, out=part)  # fmin ignores NaN, for rays that miss


def _tiles(area: NDArray[np.int64]) -> Iterator[slice]:
    """The shapes with these areas (L,) in pixels that fill a tile together; of those in a tile, the
    last are the largest.
    """
    first = 0
    while first < len(area):
        last = first + 1
        while last < len(area) and (last + 1 - first) * area[last] <= _TILE:
            last += 1
        yield slice(first, last)
        first = last


def _slopes(pixels: NDArray[np.int64], middle: float, focal: float) -> Floats:
    """Slopes of the rays through image columns or rows (N, size), where -1 is a pixel
    outside the image.
    """
    slopes = ((pixels - middle) / focal).astype(np.float32)
    outside = pixels < 0
    before = np.cumsum(~outside, axis=1) == 0
    slopes[outside] = _OUTSIDE
    slopes[before] = -_OUTSIDE
    return slopes


def _visible_ends(capsules: Capsules) -> tuple[Array, Array, Array, Array]:
    """The capsules flattened to (N M, ...), y down; those with one visible sphere are replaced
    by that sphere.
    """
    a = capsules.a.reshape(-1, 3) * (1, -1, 1)
    b = capsules.b.reshape(-1, 3) * (1, -1, 1)
    ra, rb = capsules.radius_a.reshape(-1), capsules.radius_b.reshape(-1)
    nearest = np.minimum(a[:, 2] - ra, b[:, 2] - rb)
    if not (nearest > 0).all():
        raise DataError(
            "a capsule lies at or behind the camera, or has a coordinate that is not a number"
        )
    _, w, e, g, q = _cones(a, b, ra, rb)
    inside = e <= 0  # one sphere contains the other, and only the larger one is visible
    end = (w < 0).astype(float)
    # The camera is inside the cone, along the axis, so the nearer end hides the rest.
    s = -g / np.where(inside, 1, e)
    in_cone = e * q - g * g <= 0
    along = ~inside & in_cone & (ra - s * w > 0)
    end = np.where(along, np.clip(s, 0, 1).round(), end)
    one = inside | along
    at_b = one & (end == 1)
    at_a = one & (end == 0)
    a, ra = np.where(at_b[:, None], b, a), np.where(at_b, rb, ra)
    b, rb = np.where(at_a[:, None], a, b), np.where(at_a, ra, rb)
    return a, b, ra, rb


def _cones(a: Array, b: Array, ra: Array, rb: Array) -> tuple[Array, Array, Array, Array, Array]:
    """B, w, e and g of the cones that the spheres of capsules (L, ...) touch, and a.a - ra^2."""
    B, w = b - a, ra - rb
    e = (B * B).sum(1) - w * w
    g = (a * B).sum(1) + ra * w
    return B, w, e, g, (a * a).sum(1) - ra * ra


def _extent(a: Array, b: Array, ra: Array, rb: Array, axis: int) -> tuple[Array, Array]:
    """Smallest and largest slope along x or y of the rays that touch each capsule."""
    bounds = []
    for c, r in ((a, ra), (b, rb)):
        p, z = c[:, axis], c[:, 2]
        reach = r * np.sqrt(p * p + z * z - r * r)  # tangents to a circle
        denominator = z * z - r * r
        bounds.append(((p * z - reach) / denominator, (p * z + reach) / denominator))
    (low_a, high_a), (low_b, high_b) = bounds
    return np.minimum(low_a, low_b), np.maximum(high_a, high_b)


def _pixels(
    slopes: Floats, frame: NDArray[np.int64], low: Array, high: Array
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Ranges of the indices of ``slopes`` (N, size) between ``low`` and ``high`` (L,), in the row
    ``frame`` (L,).
    """
    own = slopes[frame]
    first = np.count_nonzero(own < low[:, None], axis=1)
    end = np.count_nonzero(own <= high[:, None], axis=1)
    return first, end


def _coefficients(a: Array, b: Array, ra: Array, rb: Array) -> Floats:
    """The coefficients of each capsule for the pixels, (13, L): a, B, k1's vector, e, g,
    k0, a.a - ra^2.
    """
    B, _, e, g, q = _cones(a, b, ra, rb)
    e = np.where(e > 0, e, 1.0)  # a single sphere: B = 0, g = 0, and any e gives s = 0
    k0 = e * q - g * g
    k1 = g[:, None] * B - e[:, None] * a
    return np.stack([*a.T, *B.T, *k1.T, e, g, k0, q]).astype(np.float32)


def _depths(coefficients: Floats, x: Floats, y: Floats) -> Floats:
    """Depths (L, h, w) of the rays of slopes x (L, 1, w) and y (L, h, 1); NaN where the
    capsule is missed.
    """
    ax, ay, az, bx, by, bz, kx, ky, kz, e, g, k0, q = coefficients[:, :, None, None]
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        dd = x * x + (y * y + 1)
        Bd = bx * x + (by * y + bz)
        k1 = kx * x + (ky * y + kz)
        k2 = e * dd
        k2 -= Bd * Bd
        root = k1 * k1
        root -= k0 * k2
        np.sqrt(np.maximum(root, 0, out=root), out=root)
        root += k1
        root /= k2  # -t
        root *= Bd
        root += g
        root *= -1 / e
        s = np.clip(root, 0, 1, out=root)
        cd = ax * x + (ay * y + az)
        Bd *= s
        cd += Bd
        # c.c - r^2 = q + 2 s g + s^2 e
        np.multiply(s, e, out=k1)
        k1 += 2 * g
        k1 *= s
        k1 += q
        k1 *= dd
        np.multiply(cd, cd, out=k2)
        k2 -= k1
        np.sqrt(k2, out=k2)
        cd -= k2
        cd /= dd
    return cd


def _triangles(capsules: Capsules) -> tuple[NDArray[np.int64], NDArray[np.int64], Array]:
    """The visible triangles of all facets: the frame and the facet of each (L,), and its corners
    (L, 3, 3), y down.
    """
    center, r = _facet_spheres(capsules)
    frame, facet = np.divmod(np.arange(len(center)), len(capsules.facets))
    sides = center[:, 1:] - center[:, :1]
    across = np.cross(sides[:, 0], sides[:, 1])
    area = np.linalg.norm(across, axis=1)
    gram = sides @ sides.swapaxes(1, 2)
    flat = area > 1e-6 * (1 + np.trace(gram, axis1=1, axis2=2))  # the centres are not collinear
    gram[~flat] = np.eye(2)
    # the part of the normal in the plane of the centres
    along_sides = np.linalg.solve(gram, (r[:, :1] - r[:, 1:])[..., None])
    within = (along_sides * sides).sum(axis=1)
    left = 1 - (within * within).sum(axis=1)
    flat &= left > 0  # otherwise one sphere is inside the hull of the others
    found = []
    for sign in (-1, 1):
        upright = np.sqrt(np.maximum(left, 0)) * sign / np.where(flat, area, 1)
        normal = within + upright[:, None] * across
        corners = center + r[..., None] * normal[:, None]
        faces_camera = (normal * corners[:, 0]).sum(axis=1) < 0
        before_camera = (corners[:, :, 2] > 0).all(axis=1)
        seen = flat & faces_camera & before_camera
        found.append((frame[seen], facet[seen], corners[seen]))
    frames, facets, every_corner = map(np.concatenate, zip(*found))
    return frames, facets, every_corner


def _facet_spheres(capsules: Capsules) -> tuple[Array, Array]:
    """Centres (L, 3, 3), y down, and radii (L, 3) of the spheres of all facets of all frames."""
    N, M = capsules.radius_a.shape
    ends = np.stack([capsules.a, capsules.b], axis=2).reshape(N, 2 * M, 3)
    radii = np.stack([capsules.radius_a, capsules.radius_b], axis=2).reshape(N, 2 * M)
    center = (ends * (1, -1, 1))[:, capsules.facets].reshape(-1, 3, 3)
    return center, radii[:, capsules.facets].reshape(-1, 3)


def _plane_coefficients(corners: Array) -> Floats:
    """The coefficients of each triangle (L, 3, 3) for the pixels, (9, L): vectors of f0, f1 and
    the sum of all.
    """
    v0, v1, v2 = corners.swapaxes(0, 1)
    f = np.stack([np.cross(v1, v2), np.cross(v2, v0), np.cross(v0, v1)])
    f /= (v0 * f[0]).sum(axis=1)[:, None]
    return np.concatenate([f[0].T, f[1].T, f.sum(axis=0).T]).astype(np.float32)


def _plane_depths(coefficients: Floats, x: Floats, y: Floats) -> Floats:
    """Depths (L, h, w) of the rays of slopes x (L, 1, w) and y (L, h, 1); NaN where the
    triangle is missed.
    """
    px, py, pz, qx, qy, qz, sx, sy, sz = coefficients[:, :, None, None]
    f0 = px * x + (py * y + pz)
    f1 = qx * x + (qy * y + qz)
    total = sx * x + (sy * y + sz)
    f2 = total - f0
    f2 -= f1
    np.minimum(f0, f1, out=f0)
    np.minimum(f0, f2, out=f0)
    with np.errstate(divide="ignore"):
        return np.where(f0 >= -_EDGE * total, 1 / total, np.float32(np.nan))
