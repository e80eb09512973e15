"""Flying pixels: at an edge, a depth camera mixes the depths of both sides into one that belongs to neither.

With a time-of-flight camera, half of the pixels along the outline of a hand lie 14 mm or more behind it, a quarter 40
mm (320 x 240 pixels, 400 mm away). A pixel is removed if a neighbour is closer to the camera by a step, and no
neighbour at about its own depth belongs to a surface. Partly hidden surfaces, such as a palm behind a finger, are kept.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from handpose.data.crops import crop
from handpose.facts.cameras import Camera

STEP_MM = 8.0  # minimum depth step between two surfaces
STEP_PX = 5.0  # minimum step in pixel widths, for wide pixels: a slope of 79 degrees
_AROUND = np.ones((3, 3), np.uint8)


def clear_crop(
    depth: NDArray[np.generic], center_uvd: ArrayLike, cube_mm: float, camera: Camera
) -> NDArray[np.float32]:
    """``crop`` of a depth image, in which flying pixels are background. Raises DataError."""
    d = float(np.asarray(center_uvd, dtype=np.float64)[2])
    return without_flying_pixels(crop(depth, center_uvd, cube_mm, camera), cube_mm / 2, d / camera.fx)


def without_flying_pixels(
    crop: NDArray[np.float32], half_mm: float, pixel_mm: float, background: float = 1.0
) -> NDArray[np.float32]:
    """A crop (S, S) in [-1, 1] in which flying pixels are background.

    half_mm   half the edge of the cube
    pixel_mm  width of a pixel of the camera's image, at the crop's depth
    """
    step = np.float32(max(STEP_MM, STEP_PX * pixel_mm) / half_mm)
    behind = crop - cv2.erode(crop, _AROUND) > step
    behind &= crop < background
    if not behind.any():
        return crop
    surface = (crop < background) & ~behind
    nearest = cv2.erode(np.where(surface, crop, np.float32(9)), _AROUND)
    farthest = cv2.dilate(np.where(surface, crop, np.float32(-9)), _AROUND)
    out = crop.copy()
    # A pixel between two surfaces belongs to the far one if it is close to it.
    out[behind & (np.abs(farthest - crop) > step) & (np.abs(nearest - crop) > step)] = background
    return out
