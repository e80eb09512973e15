"""handpose/estimate/prediction.py"""

from __future__ import annotations

import numpy as np

from handpose.estimate.prediction import Prediction
from handpose.frames.cameras import NYU


def test_a_hand_in_three_units() -> None:
    """Joints are in half-cubes and in mm from the crop's centre, and in mm in front of the camera."""
    joints = np.array([[0.0, 0, 0], [1, -0.5, 0.25]])
    crop = np.zeros((128, 128), np.float32)
    found = Prediction(joints, joints, crop, 300.0, "right", None, NYU, np.array([NYU.u0, NYU.v0, 700]))
    np.testing.assert_allclose(found.joints_mm, [[0, 0, 0], [150, -75, 37.5]])
    np.testing.assert_allclose(found.center_mm, [0, 0, 700])
    np.testing.assert_allclose(found.xyz, [[0, 0, 700], [150, -75, 737.5]])
