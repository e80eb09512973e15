"""Residuals of the silhouette and of free space: they keep spheres along the bones out of empty space.

Surface points attract capsules to observed depth, but do not keep a limb out of empty space. Spheres along the
capsules' axes do. A sphere of radius r at c, which projects to (column, row) of the crop,

    leaves the silhouette by            F(column, row) z / z_0 + r       F: mm outside, at the centre's depth
    is in front of the surface by       nearest(column, row) - (z - r)

Each is a residual where it exceeds a slack, otherwise 0. F is interpolated between pixels, and so is its slope.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from handpose.depth_fit.body import CapsuleModel
from handpose.depth_fit.observation import BACKGROUND, Floats, Observation
from handpose.depth_fit.residuals import Cones, Residuals

PLACES = (1.0,)  # positions of the spheres on each capsule's axis; another one in the middle improves nothing


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
