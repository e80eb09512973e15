"""handpose/estimate/pipeline.py, through a predictor, for crops and for places in frames."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

import netlib
from handpose.body.nyu import CENTER_IN_PALM, CUBE_MM
from handpose.body.sides import Side, mirror_of
from handpose.estimate import pipeline
from handpose.estimate.packaged import load_predictor
from handpose.estimate.pipeline import MAX_MOVE_MM
from handpose.estimate.predictor import Predictor
from handpose.frames.cameras import KINECT2, Camera
from handpose.frames.crops import clear_crop
from layers.hand import skeleton
from netlib.errors import DataError, NetlibError
from tests.handpose.estimate.conftest import some_crop

HAND = skeleton.load()


def test_a_hand_behind_the_camera(fixed: Callable[..., netlib.Net], frame: np.ndarray) -> None:
    """A predicted joint behind the camera raises an error."""
    with pytest.raises(
        DataError, match=r"a pose is predicted in which a joint is at a depth of -\d+ mm, behind the camera"
    ):
        Predictor(fixed(0, 0, -140), KINECT2, refine=0).in_frame(frame, (260, 210, 160))


def test_a_crop_at_rest_is_looked_at_once(
    seeing: netlib.Net, frame: np.ndarray, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A crop that does not move is evaluated once, for any limit on the moves."""
    looks: list[int] = []
    monkeypatch.setattr(pipeline, "recenter", lambda joints, skeleton, center, *rest: looks.append(1) or center.copy())
    found = Predictor(seeing, KINECT2, refine=100).in_frame(frame, (260, 210, 690))
    assert len(looks) == 1 and found.center_uvd.tolist() == [260, 210, 690]


@pytest.mark.parametrize("hand", ["right", "left"])
@pytest.mark.parametrize("refine", [0, 1, 2, 3])
def test_the_crop_goes_to_the_palm(
    fixed: Callable[..., netlib.Net], frame: np.ndarray, refine: int, hand: Side
) -> None:
    """Each refinement moves the crop by the hand's offset, and the result has the last crop."""
    beside = np.array([10.0, -5.0, 4.0]) * mirror_of(hand)
    predictor = Predictor(fixed(10, -5, 4), KINECT2, refine=refine, hand=hand)
    start = np.array([260.0, 210.0, 690.0])
    found = predictor.in_frame(frame, start)
    np.testing.assert_allclose(found.center_mm, KINECT2.unproject(start) + refine * beside, atol=1e-3)
    np.testing.assert_array_equal(found.crop, clear_crop(frame, found.center_uvd, CUBE_MM, KINECT2))


def test_a_crop_as_in_training_stays(fixed: Callable[..., netlib.Net], frame: np.ndarray) -> None:
    """A crop whose centre is at its place in the palm does not move."""
    found = Predictor(fixed(0, 0, 0), KINECT2).in_frame(frame, (260, 210, 690))
    np.testing.assert_allclose(found.center_uvd, (260, 210, 690), atol=1e-3)
    palm = found.joints_mm[HAND.joint_names.index("palm")]
    assert np.linalg.norm(palm) == pytest.approx(np.linalg.norm(CENTER_IN_PALM), abs=1e-3)


def test_a_prediction_gone_astray(fixed: Callable[..., netlib.Net], frame: np.ndarray) -> None:
    """A wrong prediction moves the crop by at most MAX_MOVE_MM, not out of the image, and not to the camera."""
    start = np.array([260.0, 210.0, 690.0])
    found = Predictor(fixed(25, 0, 0), KINECT2, refine=9).in_frame(frame, start)
    moved = np.linalg.norm(found.center_mm - KINECT2.unproject(start))
    assert moved == pytest.approx(50, abs=1e-3) and moved < MAX_MOVE_MM
    near = np.array([260.0, 210.0, 155.0])
    found = Predictor(fixed(0, 0, -20), KINECT2).in_frame(frame, near)
    np.testing.assert_array_equal(found.center_uvd, near)
    corner = np.array([-40.0, 210.0, 690.0])
    found = Predictor(fixed(-50, 0, 0), KINECT2, cube_mm=200).in_frame(frame, corner)
    np.testing.assert_array_equal(found.center_uvd, corner)


def test_a_hand_beside_the_start(frame: np.ndarray) -> None:
    """A start 25 mm off is near enough if the unmoved crop competes; a start outside the image is an error."""
    predictor = load_predictor(KINECT2, fit="fast", hand="right")
    for beside in ((0, 0, 0), (25, 0, 0)):
        start = KINECT2.project(np.array([30.0, -20, 700]) + beside)
        found = predictor.pipeline.in_frame(frame, KINECT2, start, unmoved_too=True)
        assert np.linalg.norm(found.center_mm - (30, -20, 700)) < 60
        assert found.fit is not None and found.camera == KINECT2
    with pytest.raises(DataError, match="lies outside the image"):
        predictor.pipeline.in_frame(frame, KINECT2, KINECT2.project(np.array([9000.0, 0, 700])))


def test_the_other_hand(seeing: netlib.Net) -> None:
    """A left hand is the mirror image of the prediction for the mirrored crop."""
    left = Predictor(seeing, hand="left").in_crop(some_crop())
    right = Predictor(seeing).in_crop(some_crop()[:, ::-1])
    np.testing.assert_array_equal(left.joints, right.joints * (-1, 1, 1))
    np.testing.assert_array_equal(left.crop, some_crop())


def test_weights_that_are_not_finite(fixed: Callable[..., netlib.Net]) -> None:
    """Weights that are not finite raise an error."""
    net = fixed(0, 0, 0)
    net.params["DoF"][1].data[4] = np.nan
    with pytest.raises(NetlibError, match="predicts joints that are not finite; check its weights"):
        Predictor(net).in_crop(some_crop())


def test_a_left_hand_is_the_mirror_image_of_a_right_one(frame: np.ndarray) -> None:
    """Mirrored images have nearly the same expected error, also with an off-centre principal point."""
    part, scores = frame[:, 150:400], []
    for depth, u0, hand in ((part, KINECT2.u0 - 150, "right"), (part[:, ::-1], 249 - (KINECT2.u0 - 150), "left")):
        camera = Camera("part", KINECT2.fx, KINECT2.fy, u0, KINECT2.v0, 250, 424)
        predictor = load_predictor(camera, fit="accurate", hand=hand)  # type: ignore[arg-type]
        center = camera.project(np.array([30.0, -20, 700]) * mirror_of(hand))
        found = predictor.in_frame(np.ascontiguousarray(depth), center)
        assert found.fit is not None and found.camera == camera
        scores.append(found.error_mm)
    assert scores[0] == pytest.approx(scores[1], rel=0.25)
