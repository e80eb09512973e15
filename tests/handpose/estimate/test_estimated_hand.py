"""handpose/estimate/hand.py"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from handpose.body.sides import MIRROR, SIDES, Side
from handpose.estimate.hand import HandEstimate, as_one_side, judge
from handpose.fit.body import SIZE_INDEX, THICKNESS_INDEX, CapsuleModel
from handpose.fit.depth_fit import DepthFit
from handpose.fit.pose_confidence import Judge
from handpose.fit.settings import FitSettings
from handpose.frames.cameras import NYU
from handpose.frames.crops import crop
from handpose.sequences.recordings import render_image
from tests.support.views import frame_of

CENTER = np.array([NYU.u0 + 40, NYU.v0, 700.0])
CROP = np.linspace(-1, 1, 128 * 128, dtype=np.float32).reshape(128, 128)
JUDGE = Judge(FitSettings())
WALL = np.full((NYU.height, NYU.width), 700.0)


def fitted(model: CapsuleModel, side: Side, cost: float = 2.5) -> HandEstimate:
    """A hand with a fit of a random pose, of 0.95 times the size and 1.1 times the thickness."""
    x = np.random.default_rng(0).uniform(0, 0.4, (1, model.variables))
    x[0, SIZE_INDEX], x[0, THICKNESS_INDEX] = np.log([0.95, 1.1])
    fit = DepthFit(
        joints=model.joints(x),
        network=model.joints(x) + 4,
        cost=np.array([cost]),
        x=x,
        parts=np.array([[1.0, 2, 3, 4]]),
        start=np.zeros(1, int),
    )
    return HandEstimate(side, CROP, CENTER, 300.0, NYU, fit.network[0], fit, model)


def test_a_hand_in_three_units() -> None:
    """Joints are in half-cubes and in mm from the crop's centre, and in mm in front
    of the camera.
    """
    joints_mm = np.array([[0.0, 0, 0], [150, -75, 37.5]])
    found = HandEstimate("right", CROP, np.array([NYU.u0, NYU.v0, 700]), 300.0, NYU, joints_mm)
    assert_allclose(found.joints, [[0, 0, 0], [1, -0.5, 0.25]])
    assert_allclose(found.joints_mm, joints_mm)
    assert_allclose(found.center_mm, [0, 0, 700])
    assert_allclose(found.xyz, [[0, 0, 700], [150, -75, 737.5]])


def test_without_a_fit() -> None:
    """The network alone says nothing of errors and sizes: all values of a fit are NaN."""
    found = HandEstimate("right", CROP, CENTER, 300.0, NYU, np.zeros((31, 3)))
    values = [found.confidence, found.error_mm, found.cost, found.size, found.selection_cost]
    assert np.isnan(values).all()
    with pytest.raises(AssertionError):
        found.capsules()


def test_values_of_the_fit(model: CapsuleModel) -> None:
    """A hand has the values of its fit, and the model's scales."""
    found = fitted(model, "right")
    assert found.cost == 2.5
    assert found.size == pytest.approx(0.95) and found.thickness == pytest.approx(1.1)
    assert_array_equal(found.inputs, found.whole_inputs[: len(model.skeleton.initial)])


@pytest.mark.parametrize("side", SIDES)
def test_a_left_hand_is_mirrored_back(model: CapsuleModel, side: Side) -> None:
    """Joints, place and surface are in camera axes; the pose in space is in the side's view."""
    found, right = fitted(model, side), fitted(model, "right")
    mirror = MIRROR if side == "left" else np.ones(3)
    assert_allclose(found.joints_mm, right.joints_mm * mirror)
    assert_array_equal(found.network_mm, right.network_mm)
    assert_allclose(found.capsules().a, right.capsules().a * mirror)
    assert_allclose(
        found.capsules(in_space=True).a, found.capsules().a + found.center_mm, atol=1e-6
    )
    assert_allclose(found.body.others, right.body.others)
    moved = found.body.place - found.view_center_mm
    assert_allclose(moved, right.body.place - right.center_mm, atol=1e-9)
    assert_allclose(found.center_mm, NYU.unproject(found.center_uvd), atol=1e-9)
    assert_array_equal(found.crop, CROP[:, ::-1] if side == "left" else CROP)


def test_an_unjudged_hand_has_no_confidence(model: CapsuleModel) -> None:
    """The selection cost is the fit's cost, and the chance of a visible hand is 1."""
    found, empty = fitted(model, "right"), fitted(model, "right", cost=np.inf)
    assert np.isnan([found.confidence, found.error_mm, *found.finger_error_mm]).all()
    assert found.chance == 1 and found.selection_cost == found.cost and empty.chance == 0
    assert np.isnan(as_one_side(replace(found, other=found), JUDGE).confidence)
    known, same = judge([found, found], frame_of(WALL, NYU), JUDGE)
    assert known.chance == known.confidence and known.selection_cost == known.error_mm
    assert known.evidence is not None and len(known.evidence.signs) == 1
    assert (same.error_mm, same.confidence) == (known.error_mm, known.confidence)


@pytest.mark.parametrize(("cost", "chance"), [(2.5, 0.5), (3.0, 1 / (1 + (2.5 / 3) ** 8))])
def test_the_side_lowers_the_confidence(model: CapsuleModel, cost: float, chance: float) -> None:
    """A side no cheaper than the other is at most half as sure, and may be as wrong as the
    other is far away.
    """
    other = fitted(model, "left", cost)
    [alone] = judge([fitted(model, "right")], frame_of(WALL, NYU), JUDGE)
    assert as_one_side(alone, JUDGE) is alone
    doubtful = as_one_side(replace(alone, other=other), JUDGE)
    assert doubtful.confidence == pytest.approx(chance * alone.confidence)
    apart = np.linalg.norm(alone.xyz - other.xyz, axis=1).mean()
    of_the_other = max(apart, alone.error_mm)
    expected = chance * alone.error_mm + (1 - chance) * of_the_other
    assert doubtful.error_mm == pytest.approx(expected)
    assert model.fingers is not None
    own, others = model.fingers.joints(np.stack([alone.xyz, other.xyz]))
    apart = np.maximum(np.linalg.norm(own - others, axis=2).mean(axis=1), alone.finger_error_mm)
    assert_allclose(doubtful.finger_error_mm, chance * alone.finger_error_mm + (1 - chance) * apart)


def test_a_crop_alone_shows_what_its_frame_shows(model: CapsuleModel) -> None:
    """A crop of a rendered frame judges a pose as the frame does, up to the rounding
    of its pixels.
    """
    hand = fitted(model, "right")
    frame = render_image(hand.capsules(in_space=True), NYU, background=1500.0)[0]
    shown = replace(hand, view_crop=crop(frame, CENTER, 300.0, NYU))
    [whole], [alone] = judge([shown], frame_of(frame, NYU), JUDGE), judge([shown], None, JUDGE)
    assert alone.error_mm == pytest.approx(whole.error_mm, rel=0.2)
    assert alone.confidence == pytest.approx(whole.confidence, abs=0.05)


def test_hands_of_both_sides_are_judged_in_their_order(model: CapsuleModel) -> None:
    """Each by the frame as its side sees it: as its mirror image by the mirrored frame."""
    right, left = fitted(model, "right"), fitted(model, "left")
    shown = render_image(right.capsules(in_space=True), NYU, background=1500.0)[0]
    frame, mirrored = frame_of(shown, NYU), frame_of(shown[:, ::-1], NYU.mirrored())
    first, other, last = judge([left, right, left], frame, JUDGE)
    [alone] = judge([right], frame, JUDGE)
    assert [first.hand, other.hand, last.hand] == ["left", "right", "left"]
    assert other.error_mm == alone.error_mm and first.error_mm == last.error_mm
    in_mirror = replace(left, camera=NYU.mirrored())
    [same] = judge([in_mirror], mirrored, JUDGE)
    assert same.error_mm == pytest.approx(alone.error_mm)
