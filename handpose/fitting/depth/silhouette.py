r"""The silhouette and the free space: spheres along the bones may not be where the camera saw that nothing is.

Points of the surface pull capsules to where something was seen; nothing so far keeps a finger from pointing into thin
air. Spheres along the capsules' axes do. One of radius r at c, which the crop shows at (column, row),

    sticks out of the silhouette by     F(column, row) z / z_0 + r       F: mm outside, as wide as at the centre's depth
    stands before the surface by        nearest(column, row) - (z - r)

Each is a residual where it is more than some slack, else 0. F is interpolated between pixels, and its slope with it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from handpose.fitting.depth.body import FleshModel, Posed
from handpose.fitting.depth.observation import BACKGROUND, Floats, Observation
from handpose.fitting.depth.residuals import Residuals, point_of

PLACES = (1.0,)  # of the spheres on each capsule's axis: with one in the middle, too, nothing gets better


def spheres_of(model: FleshModel) -> tuple[NDArray[np.int_], Floats]:
    """Which capsule, and where on its axis: spheres on all capsules of the skeleton's own joints."""
    own = np.flatnonzero(~model.flesh.limbs)
    return np.repeat(own, len(PLACES)), np.tile(np.array(PLACES, np.float32), len(own))


def sphere_residuals(
    model: FleshModel, posed: Posed, seen: Observation, spheres: tuple[NDArray[np.int_], Floats], slack: float
) -> Residuals:
    """How far in mm each sphere sticks out of the silhouette, and how far it stands before the surface."""
    N, S = len(posed.ends), seen.outside.shape[-1]
    capsule = np.broadcast_to(spheres[0], (N, len(spheres[0])))
    place = np.broadcast_to(spheres[1], capsule.shape)
    c, radius = point_of(model, posed, capsule, place)
    x, y, z = np.moveaxis(c + seen.center[:, None], -1, 0)
    column = seen.offset[:, :1] + seen.factor[:, :1] * x / z
    row = seen.offset[:, 1:] - seen.factor[:, 1:] * y / z
    shown = (column >= 0) & (column < S - 1) & (row >= 0) & (row < S - 1) & (z > 0)
    column, row = np.where(shown, column, 0), np.where(shown, row, 0)
    j, i = column.astype(np.int64), row.astype(np.int64)
    fj, fi = column - j, row - i
    first = (np.arange(N)[:, None] * S + i) * S + j
    F = seen.outside.reshape(-1)
    upper, lower = F[first], F[first + S]
    across_upper, across_lower = F[first + 1] - upper, F[first + S + 1] - lower
    upper, lower = upper + fj * across_upper, lower + fj * across_lower
    outside, down = upper + fi * (lower - upper), lower - upper
    across = across_upper + fi * (across_lower - across_upper)

    wider = z / seen.center[:, 2:]
    out = outside * wider + radius - np.float32(slack)
    kx, ky = seen.factor[:, :1] / seen.center[:, 2:], seen.factor[:, 1:] / seen.center[:, 2:]
    towards = outside / seen.center[:, 2:] - (across * kx * x - down * ky * y) / z
    direction = np.stack([across * kx, -down * ky, towards], axis=-1)
    surface = seen.nearest.reshape(-1)[(np.arange(N)[:, None] * S + np.rint(row).astype(np.int64)) * S
                                       + np.rint(column).astype(np.int64)]  # fmt: skip
    before = surface - (c[..., 2] - radius) - np.float32(slack)
    known = surface < BACKGROUND * seen.half[:, None]
    active = np.stack([shown & (out > 0), shown & known & (before > 0)], axis=2).astype(np.float32)
    ahead = np.broadcast_to(np.array([0, 0, -1], np.float32), c.shape)
    return Residuals(  # 0, and moving with nothing, where they are not active
        capsule,
        place,
        np.stack([direction, ahead], axis=2) * active[..., None],
        radius[..., None] * active,
        np.stack([out, before], axis=2) * active,
    )
