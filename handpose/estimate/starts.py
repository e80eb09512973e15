"""Where a fit of a hand starts: at a given pixel, or at the palm that a network predicts.

``recenter`` moves a crop to the palm that the network predicts in it, as in the training crops (joint 34 of the NYU
annotation).
"""

from __future__ import annotations

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

PALM_MM = 15.0  # from the surface of the palm to its middle


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
