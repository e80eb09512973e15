"""Facts about the NYU hand pose data set (Tompson et al., 2014), and how the model's joints lie
among its joints.

72,757 training and 8,252 test frames of a Kinect v1, 640 x 480, with 36 annotated joints. The
annotation counts joints from 0 here: "joint 34", the centre of every crop, is the 35th.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

TRAIN_FRAMES = 72757
TEST_FRAMES = 8252
SECOND_SUBJECT_INDEX = 2440  # test frames from this 0-based index on show a second, smaller hand

ANNOTATED_JOINTS = 36  # points per frame
CENTER_JOINT = 34  # the annotated joint at which crops are centred
# mm in the frame of the model's palm: where joint 34 is, which the model lacks
CENTER_IN_PALM = (-16.7, -21.5, 5.1)

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

# The 14 joints on which results on NYU are compared, as annotated, and the same as
# joints of the model.
EVALUATION_ANNOTATIONS = (0, 3, 6, 9, 12, 15, 18, 21, 24, 25, 27, 30, 31, 32)
EVALUATION_JOINTS = tuple(ANNOTATION_OF_JOINT.index(j) for j in EVALUATION_ANNOTATIONS)


def cube_of_test_frame(index: ArrayLike) -> NDArray[np.float64]:
    """Edge in mm of the cube around the hand in each test frame, by its 0-based index."""
    return np.where(np.asarray(index) < SECOND_SUBJECT_INDEX, CUBE_MM, SECOND_CUBE_MM)


def half_cubes(frames: int) -> NDArray[np.float64]:
    """Half the cube's edge (frames,) in mm for the first ``frames`` test frames.

    If these are all test frames, the second subject's are smaller; otherwise the first subject's
    size is used for all, and ``one_size_for_all`` is the warning.
    """
    return cube_of_test_frame(np.arange(frames) if frames == TEST_FRAMES else np.zeros(frames)) / 2


def one_size_for_all(frames: int) -> str:
    """A warning if ``half_cubes`` uses one subject's size for all of ``frames`` test
    frames, else empty.
    """
    if frames == TEST_FRAMES:
        return ""
    return f"warning: {frames} of {TEST_FRAMES} test frames; the first subject's size of hand is used for all"


def frame_name(index: int) -> str:
    """File name of the depth frame with this 0-based index."""
    return f"depth_1_{index + 1:07d}.png"
