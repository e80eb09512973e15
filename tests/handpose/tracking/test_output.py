"""handpose/tracking/output.py: from an estimated pose to the values of a track"""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from handpose.body.sides import SIDES, Side, mirror_of, pixel_of
from handpose.estimate.hand import Hand, judge
from handpose.fit.body import SIZE_INDEX, CapsuleModel
from handpose.fit.depth_fit import DepthFit
from handpose.fit.pose_confidence import Judge
from handpose.fit.settings import FitSettings
from handpose.frames.cameras import NYU
from handpose.sequences.recordings import render_image
from handpose.tracking.output import tracked_hand
from handpose.tracking.track import TrackedHand, joints_of
from tests.support.views import frame_of

CENTER = np.array([350.0, 200, 650])  # px, px, mm
JUDGE = Judge(FitSettings())
EMPTY = np.zeros((NYU.height, NYU.width), np.float32)


def image_of(model: CapsuleModel, side: Side = "right") -> np.ndarray:
    """The depth image of this pose as a hand of this side, in front of a wall."""
    mirror = mirror_of(side)[None]
    x, origin = variables(model)[None], NYU.unproject(CENTER) * mirror
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
    x, one = variables(model)[None], np.ones(1)
    signs = np.array([[30.0, 2, 0.2, 5, 10]])
    fit = DepthFit(model.joints(x), model.joints(x), one, one, x, signs, one)
    hand = Hand(
        side,
        np.zeros((128, 128), np.float32),
        pixel_of(CENTER, NYU, side),
        300.0,
        NYU,
        np.zeros((31, 3)),
        fit,
        model,
    )
    [seen] = [hand] if readings is None else judge([hand], frame_of(readings, NYU), JUDGE)
    return SimpleNamespace(
        estimate=seen, smooth=seen.body._replace(place=seen.body.place + (apart, 0, 0)), time=time
    )


def output(
    model: CapsuleModel,
    *states: Any,
    smooth: bool = False,
    surface: bool = False,
    size: float | None = None,
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
        presence=0.5,
        judge=JUDGE,
    )
    return tracked_hand(track, model, smooth=smooth, surface=surface)


@pytest.mark.parametrize("side", SIDES)
@pytest.mark.parametrize("apart", [None, 6.0])
def test_a_hand(model: CapsuleModel, side: Side, apart: float | None) -> None:
    """The joints are those of the body, smoothed if asked for, and of the reported inputs; all else
    is as estimated.
    """
    hand = output(model, state(model, side, apart or 9.0), smooth=apart is not None, surface=True)
    origin, raw = NYU.unproject(CENTER), model.joints(variables(model)[None])[0]
    xyz = (raw + (apart or 0.0, 0, 0)) * mirror_of(side) + origin
    np.testing.assert_allclose(hand.xyz, xyz, atol=1e-4)
    again = joints_of(model.skeleton, 150.0, side, hand.inputs, hand.bones, hand.origin_mm)
    np.testing.assert_allclose(again, hand.xyz, atol=1e-9)
    np.testing.assert_allclose(hand.bones, 0.95 * model.skeleton.bones)
    np.testing.assert_allclose(hand.origin_mm, origin)
    assert (hand.id, hand.hand, hand.cube_mm) == (4, side, 300)
    np.testing.assert_allclose(hand.center_uvd, CENTER)
    assert (hand.side_confidence, hand.other, hand.presence) == (1, None, max(0.5, hand.confidence))
    assert (hand.raw_xyz is None) == (hand.poses is None) == (apart is None)
    if hand.raw_xyz is not None:
        np.testing.assert_allclose(hand.raw_xyz, raw * mirror_of(side) + origin, atol=1e-4)
    assert hand.capsules is not None and (hand.capsules.radius_a > 0).all()
    ends = np.concatenate([hand.capsules.a[0], hand.capsules.b[0]])
    # the surface is around them
    assert np.median(np.linalg.norm(hand.xyz[:, None] - ends, axis=2).min(axis=1)) < 10


def test_a_known_size(model: CapsuleModel) -> None:
    """A known size determines the bones, regardless of the size found in this frame."""
    hand = output(model, state(model, "right"), smooth=True, size=1.08)
    np.testing.assert_allclose(hand.bones, 1.08 * model.skeleton.bones)
    assert hand.capsules is None


def test_a_hand_of_an_undecided_side(model: CapsuleModel) -> None:
    """It has the same hand as one of the other side, if that was seen, too; confidences
    are multiplied.
    """
    right, left = (state(model, side, readings=image_of(model)) for side in SIDES)
    alone, both = output(model, right), output(model, right, left)
    assert (both.hand, both.side_confidence, both.other.hand) == ("right", 0.7, "left")
    assert (
        both.confidence == pytest.approx(0.7 * alone.confidence) and both.error_mm == alone.error_mm
    )
    assert (
        both.other.side_confidence == pytest.approx(0.3) and both.presence == alone.confidence > 0.5
    )
    np.testing.assert_allclose(both.other.xyz, output(model, left).xyz)
    assert output(model, right, state(model, "left", time=-1.0)).other is None


def test_confidence_and_error_are_of_the_reported_pose(model: CapsuleModel) -> None:
    """A smoothed pose apart from the fit, a covered hand and a hand without readings
    are less certain.
    """
    image = image_of(model)
    covered = image.copy()
    covered[:, : int(np.median(np.argwhere(image < 1000)[:, 1]))] = 400

    def judged(readings: np.ndarray, apart: float | None = None) -> tuple[float, float]:
        hand = output(
            model, state(model, "right", apart or 0.0, readings), smooth=apart is not None
        )
        return hand.confidence, hand.error_mm

    whole, error = judged(image)
    assert whole > 0.9 and error < 20
    for worse in (judged(image, 30), judged(covered), judged(EMPTY)):
        assert worse[0] < whole - 0.05 and worse[1] > error + 2
    assert judged(EMPTY)[0] < 0.1
    assert judged(image, 0) == pytest.approx((whole, error))


@pytest.mark.parametrize("side", SIDES)
def test_the_error_of_each_finger(model: CapsuleModel, side: Side) -> None:
    """What covers the thumb raises its expected error most, also of a left hand."""
    image, thumb = image_of(model, side), model.skeleton.joint_names.index("thumb_tip")
    u, v, _ = np.rint(NYU.project(output(model, state(model, side)).xyz[thumb])).astype(int)
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
