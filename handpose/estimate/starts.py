"""Where a fit of a hand starts: at the nearest surface, at a given pixel, or at the palm that a network predicts.

``find_hand`` gives the centre of mass of the nearest object, ``depth_around`` the depth at a pixel. ``recenter`` moves
a crop to the palm that the network predicts in it, as in the training crops (joint 34 of the NYU annotation).
"""

from __future__ import annotations

import math

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from handpose.body.joint_formats.frames import palm_frame
from handpose.body.nyu import CENTER_IN_PALM
from handpose.body.sides import Side, mirror_of
from handpose.fit.rounding import PLACE_STEP_MM, rounded
from handpose.frames.cameras import Camera
from handpose.frames.images import depth_image
from layers.hand.skeleton import Skeleton
from netlib.blob import Array
from netlib.errors import DataError

# Tuned on whole images of rendered hands: half of the centres are within 31 mm of the true one, nine of ten within
# 55 mm.
FRONT_MM2 = 1500.0  # minimum visible area of the nearest object; less is noise
SLAB_MM = 160.0  # depth range behind the front that contains the hand
REACH_MM = 125.0  # radius about the centre of mass: the hand, and little of the forearm
PALM_MM = 15.0  # from the surface of the palm to its middle
BEHIND_MM = 38.0  # from the mean of the visible points, which are in front, to the centre
MAX_PIXELS = 1 << 21  # larger images are subsampled


def find_hand(depth: NDArray[np.generic], camera: Camera) -> Array:
    """Centre (3,), u, v in px and d in mm, of the nearest object in a depth image (height, width) in mm.

    Raises DataError if there is no surface as large as a hand.
    """
    whole = depth_image(depth)
    step = max(1, math.ceil(math.sqrt(whole.size / MAX_PIXELS)))
    image = np.asarray(whole[step // 2 :: step, step // 2 :: step])
    seen = np.isfinite(image) & (image > 0)
    if not seen.any():
        raise DataError("no depth anywhere in the image")
    depths = np.sort(image[seen]).astype(np.float64)  # integers are sorted faster
    image = np.asarray(image, dtype=np.float64)
    surface = step**2 * np.cumsum(depths**2) / (camera.fx * camera.fy)  # visible area in mm² up to each depth
    if surface[-1] < FRONT_MM2:
        raise DataError(f"only {surface[-1]:.0f} mm² of surface in the image, expected a hand")
    front = depths[np.searchsorted(surface, FRONT_MM2)]
    slab = seen & (image <= front + SLAB_MM)
    _, label, _, _ = cv2.connectedComponentsWithStats(slab.astype(np.uint8), connectivity=8)
    nearest = seen & (image <= front)
    shown = np.bincount(label[nearest], weights=image[nearest] ** 2)  # area, because near specks have many pixels
    one = label == 1 + np.argmax(shown[1:])
    v, u = (step // 2 + step * pixels for pixels in np.nonzero(one))
    points = np.ascontiguousarray(camera.unproject(np.stack([u, v, image[one]], axis=1)).T)
    near = nearest[one]
    for _ in range(11):
        center = (points * near).sum(axis=1) / near.sum()
        off = points - center[:, None]
        before, near = near, (off * off).sum(axis=0) < REACH_MM**2
        if not near.any() or np.array_equal(near, before):
            break
    return camera.project(center + (0, 0, BEHIND_MM))


def depth_around(depth: NDArray[np.generic], u: float, v: float, reach: int = 8) -> Array:
    """Centre (3,) at pixel u, v with the median depth around it: u, v in px and d in mm. Raises DataError."""
    image = depth_image(depth)
    row, column = round(v), round(u)
    if not (0 <= row < image.shape[0] and 0 <= column < image.shape[1]):
        raise DataError(f"pixel {u:g}, {v:g} lies outside the image of {image.shape[1]} x {image.shape[0]}")
    around = image[max(row - reach, 0) : row + reach + 1, max(column - reach, 0) : column + reach + 1]
    seen = around[np.isfinite(around) & (around > 0)]
    if not len(seen):
        raise DataError(f"no depth around pixel {u:g}, {v:g}")
    return np.array([u, v, np.median(seen) + PALM_MM])


def recenter(
    joints: ArrayLike, skeleton: Skeleton, center_uvd: ArrayLike, cube_mm: float, camera: Camera, side: Side = "right"
) -> Array:
    """The crop centre (3,) for joints predicted in the crop at ``center_uvd``, as in the training crops.

    joints  (K, 3) half-cubes from the crop centre; those of a left hand mirrored
    side    of the hand

    For nets trained with NYU's centres; those of other data sets are elsewhere in the palm (ICVL's at its joint).
    Raises DataError if the skeleton has no palm.
    """
    if "palm" not in skeleton.joint_names:
        raise DataError(f"skeleton {skeleton.name!r} has no joint 'palm' to move the crop to")
    mirror = mirror_of(side)
    hand = np.asarray(joints, dtype=np.float64).reshape(-1, 3)
    palm = hand[skeleton.joint_names.index("palm")]
    move = rounded(palm * cube_mm / 2 + palm_frame(hand, skeleton) @ CENTER_IN_PALM, PLACE_STEP_MM)
    return camera.project(camera.unproject(np.asarray(center_uvd, dtype=np.float64)) + move * mirror)
