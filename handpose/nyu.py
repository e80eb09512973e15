"""What is particular to the NYU hand pose data set (Tompson et al., 2014).

72,757 training and 8,252 test frames of a Kinect v1, 640 x 480, with 36 annotated joints. The annotation
counts joints from 0 here: "joint 34", the centre of every crop, is the 35th.
"""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from netlib.errors import DataError

ANNOTATED_JOINTS = 36  # points a frame in joint_data.mat
CENTER_JOINT = 34  # the annotated joint at which crops are centred
TEST_FRAMES = 8252
SECOND_SUBJECT = 2440  # test frames from this 0-based index on show a second, smaller hand
CUBE_MM = 300.0  # edge of the cube around the hand
SECOND_CUBE_MM = 300.0 * 0.87  # ... around the second subject's hand

# The annotated joint of each of the model's 31 joints.
ANNOTATION_OF_JOINT = (
    *(0, 1, 2, 3, 4),  # little finger, tip to base
    *(6, 7, 8, 9, 10),  # ring
    *(12, 13, 14, 15, 16),  # middle
    *(18, 19, 20, 21, 22),  # index
    *(5, 11, 17, 23),  # knuckles: little, ring, middle, index
    *(32, 30, 31),  # palm, two points of the wrist
    *(28, 27, 25, 24),  # thumb, root to tip
)

# The 14 joints on which results on NYU are compared, as annotated, and the same as joints of the model.
EVALUATION_ANNOTATIONS = (0, 3, 6, 9, 12, 15, 18, 21, 24, 25, 27, 30, 31, 32)
EVALUATION_JOINTS = tuple(ANNOTATION_OF_JOINT.index(j) for j in EVALUATION_ANNOTATIONS)


def cube_of_test_frame(index: ArrayLike) -> NDArray[np.float64]:
    """Edge in mm of the cube around the hand in each test frame, by its 0-based index."""
    return np.where(np.asarray(index) < SECOND_SUBJECT, CUBE_MM, SECOND_CUBE_MM)


def frame_name(index: int) -> str:
    """File name of the depth frame with this 0-based index."""
    return f"depth_1_{index + 1:07d}.png"


def read_nyu_depth(path: str | Path) -> NDArray[np.float32]:
    """Depth (480, 640) in mm of one frame; 0 where the camera read nothing. Raises DataError.

    The file is an RGB image: depth = 256 green + blue, as 16-bit grey would be (red is unused).
    """
    image = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    if image is None:
        reason = "not a readable image" if Path(path).is_file() else "no such file"
        raise DataError(f"{path}: {reason} (expected an NYU depth frame such as {frame_name(0)})")
    if image.ndim != 3 or image.shape[2] < 3 or image.dtype != np.uint8:
        raise DataError(f"{path}: found {image.dtype} of shape {image.shape}, expected 8-bit RGB packing the depth")
    return image[..., 1].astype(np.float32) * 256 + image[..., 0]
