"""handpose/prediction/crop_hands.py: as a predictor uses it, on crops and at places of frames."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

import netlib
from handpose.facts.cameras import KINECT2, Camera
from handpose.facts.sides import mirror_of
from handpose.prediction.packaged import load_predictor
from handpose.prediction.predictor import Predictor
from netlib.errors import NetlibError
from tests.handpose.prediction.conftest import some_crop


def test_the_other_hand(seeing: netlib.Net) -> None:
    """The mirror image of what is seen in the mirrored crop."""
    left = Predictor(seeing, hand="left").in_crop(some_crop())
    right = Predictor(seeing).in_crop(some_crop()[:, ::-1])
    np.testing.assert_array_equal(left.joints, right.joints * (-1, 1, 1))
    np.testing.assert_array_equal(left.crop, some_crop())


def test_weights_that_are_not_finite(fixed: Callable[..., netlib.Net]) -> None:
    """Never a picture of nothing."""
    net = fixed(0, 0, 0)
    net.params["DoF"][1].data[4] = np.nan
    with pytest.raises(NetlibError, match="predicts joints that are not finite; check its weights"):
        Predictor(net).in_crop(some_crop())


def test_a_left_hand_is_the_mirror_image_of_a_right_one(frame: np.ndarray) -> None:
    """As little strange, also before a camera that does not look from the middle of its image."""
    part, strange = frame[:, 150:400], []
    for depth, u0, hand in ((part, KINECT2.u0 - 150, "right"), (part[:, ::-1], 249 - (KINECT2.u0 - 150), "left")):
        camera = Camera("part", KINECT2.fx, KINECT2.fy, u0, KINECT2.v0, 250, 424)
        predictor = load_predictor(camera, fit="accurate", hand=hand)  # type: ignore[arg-type]
        center = camera.project(np.array([30.0, -20, 700]) * mirror_of(hand))
        found = predictor.in_frame(np.ascontiguousarray(depth), center)
        assert found.fit is not None and found.camera == camera
        strange.append(found.fit.strangeness)
    assert strange[0] == pytest.approx(strange[1], rel=0.2)
