"""Where the crop of a hand belongs: at a place in the palm."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from handpose.body.joint_formats.frames import palm_frame
from handpose.body.nyu import CENTER_IN_PALM
from handpose.fit.rounding import PLACE_STEP_MM, rounded
from handpose.frames.cameras import Camera
from layers.hand.skeleton import Skeleton
from netlib.blob import Array
from netlib.errors import DataError


def recenter(
    joints: ArrayLike, skeleton: Skeleton, center_uvd: ArrayLike, cube_mm: float, camera: Camera
) -> Array:
    """The crop centre (3,) for the joints (K, 3) of a right hand that are predicted in the crop at
    ``center_uvd``, in half-cubes from there, as in the training crops.

    For nets trained with NYU's centres; those of other data sets are elsewhere in the palm
    (ICVL's at its joint). Raises DataError if the skeleton has no palm.
    """
    if "palm" not in skeleton.joint_names:
        raise DataError(f"skeleton {skeleton.name!r} has no joint 'palm' to move the crop to")
    hand = np.asarray(joints, dtype=np.float64).reshape(-1, 3)
    palm = hand[skeleton.joint_names.index("palm")]
    move = rounded(palm * cube_mm / 2 + palm_frame(hand, skeleton) @ CENTER_IN_PALM, PLACE_STEP_MM)
    return camera.project(camera.unproject(np.asarray(center_uvd, dtype=np.float64)) + move)
