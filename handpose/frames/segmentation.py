"""The hand in a crop, separated from what surrounds it: the forearm beyond the wrist, a body, a table, other objects.

Network and fit expect one hand in front of a background. In scenes with a person and a table, most of a crop may be
something else, and the fit of a hand slides along the forearm or onto the table. ``alone`` keeps readings that

    lie within REACH_MM of the crop's centre, in space, and
    belong to the surface at the centre, or to a surface that lies within that distance as a whole, such as a finger

Surfaces end at depth steps.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from handpose.frames.cameras import Camera
from handpose.frames.crops import BACKGROUND, NEAR_FACE, window

REACH_MM = 115.0  # from the centre of a crop to what may belong to its hand
STEP_MM, STEP_PX = 18.0, 5.0  # minimum depth step between two surfaces: in mm, and in widths of a pixel
CENTER_MM = 30.0  # the surface at the centre has the most readings, each weighted by 1 / (1 + (distance / this)²)
MIN_WITHIN = 0.95  # share of another surface's readings within the reach: it belongs to the hand
_AROUND = np.ones((3, 3), np.uint8)


def alone(
    crop: NDArray[np.float32], center_uvd: ArrayLike, cube_mm: float, camera: Camera, reach_mm: float = REACH_MM
) -> NDArray[np.float32]:
    """A crop (S, S) in [-1, 1] in which the surroundings of the hand at its centre are background.

    center_uvd  (3,) px, px, mm: the crop's centre
    cube_mm     edge of its cube
    """
    half, uvd = np.float32(cube_mm / 2), np.asarray(center_uvd, dtype=np.float64)
    seen = (crop < BACKGROUND) & (crop > NEAR_FACE)
    if not seen.any():
        return crop
    picked = window(uvd[None], cube_mm, camera, len(crop))
    away = crop * half  # from the centre, along z
    z = away + np.float32(uvd[2])
    x = z * ((picked.columns[0] - uvd[0]) / camera.fx).astype(np.float32)
    y = z * ((picked.rows[0] - uvd[1]) / camera.fy).astype(np.float32)[:, None]
    # Sideways from the ray through the centre: the difference from the distance in space is small in a crop.
    squared = x * x + y * y + away * away
    near = seen & (squared < reach_mm**2)
    if not near.any():
        return np.full_like(crop, BACKGROUND)
    step = max(STEP_MM, STEP_PX * float(uvd[2]) / camera.fx) / half
    behind = seen & (crop - cv2.erode(crop, _AROUND) > step)  # the far side of a depth step
    count, component = cv2.connectedComponents((seen & ~behind).astype(np.uint8), connectivity=8)
    weight = np.bincount(component[near], 1 / (1 + squared[near] / CENTER_MM**2), count)
    weight[0] = 0
    within = np.bincount(component[near], minlength=count) / np.maximum(np.bincount(component.reshape(-1)), 1)
    own = within >= MIN_WITHIN
    own[np.argmax(weight)] = True
    own[0] = False
    kept = own[component]
    # Pixels on the far side of a step belong to the surface next to them.
    farthest = cv2.dilate(np.where(kept, crop, np.float32(-9)), _AROUND)
    kept |= behind & (np.abs(farthest - crop) <= step)
    return np.where(kept & near, crop, np.float32(BACKGROUND))
