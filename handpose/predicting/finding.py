"""Where is the hand in a depth image? The nearest thing, as everyone holds it; then its centre of mass.

Good enough to start from: ``recenter`` then moves the crop to where the network sees the palm, as training crops have
it (joint 34 of the NYU annotation; ``handpose.synthetic.PosePrior.center_in_palm``).
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from handpose.camera import Camera
from handpose.synthetic import PosePrior
from layers.kinematics import Skeleton
from netlib.errors import DataError

Array = NDArray[np.float64]

# Tuned on synthetic frames in NYU's format (tools/make_synthetic.py --raw): half of the centres are within 31 mm of the
# true one, nine of ten within 55 mm.
FRONT_MM2 = 1500.0  # of surface that the nearest thing must show, else it is noise
SLAB_MM = 160.0  # behind its front, where the rest of a hand is
REACH_MM = 125.0  # from its centre of mass: the hand, and not much of the forearm
PALM_MM = 15.0  # from the surface of a palm to its middle
BEHIND_MM = 38.0  # the centre lies so far behind the mean of what is seen, which is its front


def find_hand(depth: ArrayLike, camera: Camera) -> Array:
    """Centre (3,), u, v in px and d in mm, of the nearest thing in a depth image (height, width) in mm.

    Raises DataError if there is no surface as large as a hand.
    """
    image = np.asarray(depth, dtype=np.float64)
    seen = np.isfinite(image) & (image > 0)
    if not seen.any():
        raise DataError("no depth anywhere in the image")
    depths = np.sort(image[seen])
    surface = np.cumsum(depths**2) / (camera.fx * camera.fy)  # mm² that pixels up to each depth show
    if surface[-1] < FRONT_MM2:
        raise DataError(f"only {surface[-1]:.0f} mm² of surface in the image, expected a hand")
    front = depths[np.searchsorted(surface, FRONT_MM2)]
    slab = seen & (image <= front + SLAB_MM)
    _, label, _, _ = cv2.connectedComponentsWithStats(slab.astype(np.uint8), connectivity=8)
    nearest = seen & (image <= front)
    shown = np.bincount(label[nearest], weights=image[nearest] ** 2)  # surface: a speck that is near has many pixels
    one = label == 1 + np.argmax(shown[1:])
    v, u = np.nonzero(one)
    points = camera.unproject(np.stack([u, v, image[one]], axis=1))
    center = points[nearest[one]].mean(axis=0)
    for _ in range(10):
        near = np.linalg.norm(points - center, axis=1) < REACH_MM
        if not near.any():
            break
        center = points[near].mean(axis=0)
    return camera.project(center + (0, 0, BEHIND_MM))


def depth_around(depth: ArrayLike, u: float, v: float, reach: int = 8) -> Array:
    """Centre (3,) at pixel u, v, at the median depth around it: u, v in px and d in mm. Raises DataError."""
    image = np.asarray(depth, dtype=np.float64)
    row, column = round(v), round(u)
    if not (0 <= row < image.shape[0] and 0 <= column < image.shape[1]):
        raise DataError(f"pixel {u:g}, {v:g} lies outside the image of {image.shape[1]} x {image.shape[0]}")
    around = image[max(row - reach, 0) : row + reach + 1, max(column - reach, 0) : column + reach + 1]
    seen = around[np.isfinite(around) & (around > 0)]
    if not len(seen):
        raise DataError(f"nothing was read around pixel {u:g}, {v:g}")
    return np.array([u, v, np.median(seen) + PALM_MM])


def recenter(
    inputs: ArrayLike, skeleton: Skeleton, center_uvd: ArrayLike, cube_mm: float, camera: Camera, mirrored: bool = False
) -> Array:
    """The crop centre (3,) at which training has the hand that was predicted as ``inputs`` (D,) about ``center_uvd``.

    Training with NYU's centres, that is: those of other data sets lie elsewhere in the palm (ICVL's at its joint).
    ``mirrored``: the inputs are of the mirror image of the crop. Raises DataError if the skeleton has no palm.
    """
    if "palm" not in skeleton.joint_names:
        raise DataError(f"skeleton {skeleton.name!r} has no joint 'palm' to move the crop to")
    pose = skeleton.forward(np.asarray(inputs, dtype=np.float64).reshape(1, -1))
    palm = skeleton.joint_names.index("palm")
    offset = skeleton.rotation_of(pose, palm)[0] @ PosePrior().center_in_palm
    center = camera.unproject(np.asarray(center_uvd, dtype=np.float64))
    move = pose.joints[palm, :, 0] * cube_mm / 2 + offset
    return camera.project(center + (move * (-1, 1, 1) if mirrored else move))
