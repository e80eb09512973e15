"""handpose/tracking/output.py: from estimates to the hands of tracks and of single images"""

from __future__ import annotations

import re
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from handpose.body.sides import SIDES, Side, mirror_of, pixel_of
from handpose.estimate.hand import HandEstimate, judge
from handpose.fit.body import SIZE_INDEX, CapsuleModel
from handpose.fit.depth_fit import DepthFit
from handpose.fit.pose_confidence import Judge
from handpose.fit.settings import FitSettings
from handpose.frames.cameras import NYU
from handpose.sequences.recordings import render_image
from handpose.tracking.hand_track import Looks
from handpose.tracking.output import predicted_hand, tracked_hand
from handpose.tracking.reasons import uncertain
from handpose.tracking.track import TrackedHand, joints_of
from netlib.errors import DataError
from tests.support.made_tracks import any_skeleton
from tests.support.views import frame_of

CENTER = np.array([350.0, 200, 650])  # px, px, mm
JUDGE = Judge(FitSettings())
EMPTY = np.zeros((NYU.height, NYU.width), np.float32)


def image_of(model: CapsuleModel, side: Side = "right") -> np.ndarray:
    """The depth image of this pose as a hand of this side, in front of a wall."""
    mirror = mirror_of(side)[None]
    x = variables(model)[None]
    origin = NYU.unproject(CENTER) * mirror
    capsules = model.capsules(x, origin).mirrored(mirror)
    return render_image(capsules, NYU, background=1500.0)[0]


def variables(model: CapsuleModel) -> np.ndarray:
    """A pose (V,)."""
    x = np.random.default_rng(0).uniform(0, 0.2, model.variables)
    x[SIZE_INDEX] = np.log(0.95)
    return x


def state(
    model: CapsuleModel,
    side: Side,
    apart: float = 6.0,
    readings: np.ndarray | None = EMPTY,
    time: float = 0.0,
) -> Any:
    """A track's state for one side: this pose, smoothed to one ``apart`` mm farther along x."""
    x = variables(model)[None]
    one = np.ones(1)
    parts = np.array([[30.0, 2, 0.2, 5]])
    fit = DepthFit(model.joints(x), model.joints(x), one, x, parts, one)
    hand = HandEstimate(
        side,
        np.zeros((128, 128), np.float32),
        pixel_of(CENTER, NYU, side),
        300.0,
        NYU,
        np.zeros((31, 3)),
        fit,
        model,
    )
    if readings is not None:
        [hand] = judge([hand], frame_of(readings, NYU), JUDGE)
    smooth = hand.body._replace(place=hand.body.place + (apart, 0, 0))
    return SimpleNamespace(estimate=hand, smooth=smooth, time=time)


def output(
    model: CapsuleModel, *states: Any, smooth: bool = False, size: float | None = None
) -> TrackedHand:
    """The output for a track with these states of its sides, the likelier one first."""
    sides = {one.estimate.hand: one for one in states}
    track: Any = SimpleNamespace(
        id=4,
        size=size,
        best=states[0],
        hand=states[0].estimate.hand,
        sides=sides,
        side_confidence=0.7 if len(states) > 1 else 1.0,
        time=0.0,
        looks=Looks(0.5),
        judge=JUDGE,
    )
    return tracked_hand(track, model, smooth=smooth)


@pytest.mark.parametrize("side", SIDES)
@pytest.mark.parametrize("smooth", [False, True])
def test_the_joints_of_a_hand(model: CapsuleModel, side: Side, smooth: bool) -> None:
    """They are those of the body, smoothed if asked for, and those of the reported inputs."""
    hand = output(model, state(model, side), smooth=smooth)
    origin = NYU.unproject(CENTER)
    in_body = model.joints(variables(model)[None])[0]
    raw, smoothed = ((in_body + (moved, 0, 0)) * mirror_of(side) + origin for moved in (0.0, 6.0))
    np.testing.assert_allclose(hand.xyz, smoothed if smooth else raw, atol=1e-4)
    pose = hand.pose
    by_inputs = joints_of(model.skeleton, 150.0, side, pose.inputs, pose.bones, pose.origin_mm)
    np.testing.assert_allclose(by_inputs, hand.xyz, atol=1e-9)
    assert (pose.raw_xyz is None) == (pose.followed is None) == (not smooth)
    if smooth:
        np.testing.assert_allclose(pose.raw_xyz, raw, atol=1e-4)


@pytest.mark.parametrize("side", SIDES)
def test_a_hand(model: CapsuleModel, side: Side) -> None:
    """All but the joints is as estimated, and the surface is around the joints."""
    hand = output(model, state(model, side))
    pose = hand.pose
    np.testing.assert_allclose(pose.bones, 0.95 * model.skeleton.bones)
    np.testing.assert_allclose(pose.origin_mm, NYU.unproject(CENTER))
    np.testing.assert_allclose(pose.center_uvd, CENTER)
    assert (hand.id, hand.hand, pose.side, pose.cube_mm) == (4, side, side, 300)
    assert (hand.side_confidence, hand.other, hand.presence) == (1, None, max(0.5, hand.confidence))
    assert pose.capsules is pose.capsules and (pose.capsules.radius_a > 0).all()
    ends = np.concatenate([pose.capsules.a[0], pose.capsules.b[0]])
    distances = np.linalg.norm(hand.xyz[:, None] - ends, axis=2).min(axis=1)
    assert np.median(distances) < 10


def test_a_known_size(model: CapsuleModel) -> None:
    """A known size determines the bones, regardless of the size found in this frame."""
    hand = output(model, state(model, "right"), smooth=True, size=1.08)
    np.testing.assert_allclose(hand.pose.bones, 1.08 * model.skeleton.bones)


def test_a_hand_of_a_single_image(model: CapsuleModel) -> None:
    """Its values are those of the estimate; without a frame, positions are from the crop's centre;
    below the minimum confidence it has a place and the reason in place of its pose.
    """
    found = replace(state(model, "left", readings=image_of(model, "left")).estimate, presence=0.5)
    hand = predicted_hand(found, model.skeleton)
    assert (hand.id, hand.known_side, hand.pose.side, hand.presence) == (0, "left", "left", 0.5)
    assert (hand.confidence, hand.error_mm) == (found.confidence, found.error_mm)
    np.testing.assert_array_equal(hand.xyz, found.xyz)
    np.testing.assert_array_equal(hand.pose.inputs, found.inputs)
    crop = predicted_hand(replace(found, in_frame=False), model.skeleton)
    np.testing.assert_array_equal(crop.xyz, found.joints_mm)
    assert not crop.pose.origin_mm.any() and np.isnan(crop.pose.center_uvd).all()
    unsure = predicted_hand(found.given(1.0), model.skeleton)
    assert unsure.pose is None and unsure.place == tuple(found.center_mm)
    assert unsure.reason == uncertain(found.confidence)
    with pytest.raises(DataError, match=rf"hand 0 has no pose: {re.escape(unsure.reason)}"):
        assert unsure.xyz


def test_another_body_of_a_single_image() -> None:
    """It has no side; what only a fit determines is unknown."""
    skeleton = any_skeleton(2)
    joints = np.zeros((7, 3))
    crop = np.zeros((128, 128), np.float32)
    body = predicted_hand(HandEstimate("right", crop, CENTER, 300.0, NYU, joints), skeleton)
    assert (body.hand, body.known_side, body.pose.side) == (None, None, "right")
    assert np.isnan([*body.pose.inputs, *body.pose.bones, body.confidence]).all()
    np.testing.assert_allclose(body.xyz, NYU.unproject(CENTER) + joints)


def test_a_hand_of_an_undecided_side(model: CapsuleModel) -> None:
    """It has the same hand as one of the other side, if that was seen, too; confidences
    are multiplied.
    """
    right, left = (state(model, side, readings=image_of(model)) for side in SIDES)
    alone = output(model, right)
    both = output(model, right, left)
    assert (both.hand, both.side_confidence, both.other.hand) == ("right", 0.7, "left")
    assert both.confidence == pytest.approx(0.7 * alone.confidence)
    assert both.error_mm == alone.error_mm
    assert both.other.side_confidence == pytest.approx(0.3)
    assert both.presence == alone.confidence > 0.5
    np.testing.assert_allclose(both.other.xyz, output(model, left).xyz)
    assert output(model, right, state(model, "left", time=-1.0)).other is None


def test_confidence_and_error_are_of_the_reported_pose(model: CapsuleModel) -> None:
    """A smoothed pose apart from the fit, a covered hand and a hand without readings
    are less certain.
    """
    image = image_of(model)
    middle = int(np.median(np.argwhere(image < 1000)[:, 1]))
    covered = image.copy()
    covered[:, :middle] = 400

    def judged(readings: np.ndarray, apart: float | None = None) -> tuple[float, float]:
        one = state(model, "right", apart or 0.0, readings)
        hand = output(model, one, smooth=apart is not None)
        return hand.confidence, hand.error_mm

    confidence, error_mm = judged(image)
    assert confidence > 0.9 and error_mm < 20
    for less, more_mm in (judged(image, 30), judged(covered), judged(EMPTY)):
        assert less < confidence - 0.05 and more_mm > error_mm + 2
    assert judged(EMPTY)[0] < 0.1
    assert judged(image, 0) == pytest.approx((confidence, error_mm))


@pytest.mark.parametrize("side", SIDES)
def test_the_error_of_each_finger(model: CapsuleModel, side: Side) -> None:
    """What covers the thumb raises its expected error most, also of a left hand."""
    image = image_of(model, side)
    thumb = model.skeleton.joint_names.index("thumb_tip")
    thumb_mm = output(model, state(model, side)).xyz[thumb]
    u, v, _ = np.rint(NYU.project(thumb_mm)).astype(int)
    covered = image.copy()
    covered[v - 15 : v + 15, u - 15 : u + 15] = 400
    whole, worse = (
        output(model, state(model, side, readings=seen)).finger_error_mm
        for seen in (image, covered)
    )
    assert whole.shape == (5,) and (whole > 0).all()
    assert worse[0] > 1.3 * whole[0] and (worse[1:] < 1.1 * whole[1:]).all()


def test_errors_without_readings_are_unknown(model: CapsuleModel) -> None:
    hand = output(model, state(model, "right", readings=None), smooth=True)
    assert np.isnan([hand.error_mm, hand.confidence, *hand.finger_error_mm]).all()
