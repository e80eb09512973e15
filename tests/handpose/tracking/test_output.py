"""handpose/tracking/output.py: from an estimated pose to the values of a track"""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from handpose.body.render import render
from handpose.body.sides import Side, mirror_of
from handpose.estimate.hand import Hand, judge
from handpose.fit.body import SIZE, CapsuleModel
from handpose.fit.depth_fit import DepthFit
from handpose.frames.cameras import NYU
from handpose.tracking.output import tracked_hand
from handpose.tracking.track import joints_of

CENTER = np.array([350.0, 200, 650])  # px, px, mm
EMPTY = np.zeros((NYU.height, NYU.width), np.float32)


@pytest.fixture(scope="module")
def image(model: CapsuleModel) -> np.ndarray:
    """The depth image of this pose as a right hand, in front of a wall."""
    x, y = (np.arange(NYU.width) - NYU.u0) / NYU.fx, (np.arange(NYU.height) - NYU.v0) / NYU.fy
    return render(model.capsules(variables(model)[None], NYU.unproject(CENTER)[None]), x[None], y[None], [1500.0])[0]


def variables(model: CapsuleModel) -> np.ndarray:
    """A pose (V,)."""
    x = np.random.default_rng(0).uniform(0, 0.2, model.variables)
    x[SIZE] = np.log(0.95)
    return x


def track(
    model: CapsuleModel, side: Side = "right", size: float | None = None, *, apart: float = 6.0,
    readings: np.ndarray | None = EMPTY, center_uvd: np.ndarray = CENTER,
) -> Any:
    """A track with this pose, smoothed to one ``apart`` mm farther along x."""
    x, one = variables(model)[None], np.ones(1)
    signs = np.array([[30.0, 2, 0.2, 5, 10]])
    fit = DepthFit(model.inputs_of(x), one, model.joints(x), model.joints(x), one, one, x, signs, one)
    hand = Hand(side, np.zeros((128, 128), np.float32), center_uvd, 300.0, NYU, np.zeros((31, 3)), fit, model)
    [seen] = [hand] if readings is None else judge([hand], readings)
    smooth = seen.body._replace(place=seen.body.place + (apart, 0, 0))
    best = SimpleNamespace(estimate=seen, smooth=smooth)
    return SimpleNamespace(id=4, size=size, best=best, hand=side, sides={side: best}, side_confidence=1.0, time=0.0,
                           presence=0.5, is_sure=True)


@pytest.mark.parametrize("side", ["right", "left"])
def test_a_hand(model: CapsuleModel, side: Side) -> None:
    """The joints are those of the body and of the reported inputs; all else is as estimated."""
    hand = tracked_hand(track(model, side), model, smooth=False, surface=False)
    mirror = mirror_of(side)
    expected = model.joints(variables(model)[None])[0] * mirror + NYU.unproject(CENTER)
    np.testing.assert_allclose(hand.xyz, expected, atol=1e-4)
    again = joints_of(model.skeleton, 150.0, side, hand.inputs, hand.bones, hand.origin_mm)
    np.testing.assert_allclose(again, hand.xyz, atol=1e-9)
    np.testing.assert_allclose(hand.bones, 0.95 * model.skeleton.bones)
    np.testing.assert_allclose(hand.origin_mm, NYU.unproject(CENTER))
    assert (hand.id, hand.hand, hand.cube_mm) == (4, side, 300)
    assert hand.capsules is None and hand.center_uvd is CENTER


@pytest.mark.parametrize(("side", "x"), [("right", 6), ("left", -6)])
def test_smoothed(model: CapsuleModel, side: Side, x: float) -> None:
    """The smoothed pose is reported, about the same crop, for a left hand mirrored."""
    one = track(model, side)
    raw, smooth = (tracked_hand(one, model, smooth=smooth, surface=False) for smooth in (False, True))
    np.testing.assert_allclose(smooth.xyz - raw.xyz, np.tile([x, 0, 0], (31, 1)), atol=1e-6)
    np.testing.assert_array_equal(smooth.origin_mm, raw.origin_mm)


def test_a_known_size(model: CapsuleModel) -> None:
    """A known size determines the bones, regardless of the size found in this frame."""
    hand = tracked_hand(track(model, size=1.08), model, smooth=True, surface=False)
    np.testing.assert_allclose(hand.bones, 1.08 * model.skeleton.bones)


@pytest.mark.parametrize("side", ["right", "left"])
def test_surface(model: CapsuleModel, side: Side) -> None:
    """The surface surrounds the reported joints."""
    hand = tracked_hand(track(model, side), model, smooth=True, surface=True)
    assert hand.capsules is not None
    ends = np.concatenate([hand.capsules.a[0], hand.capsules.b[0]])
    nearest = np.linalg.norm(hand.xyz[:, None] - ends, axis=2).min(axis=1)
    assert np.median(nearest) < 10 and (hand.capsules.radius_a > 0).all()


def test_confidence_and_error_are_of_the_reported_pose(model: CapsuleModel, image: np.ndarray) -> None:
    """A smoothed pose apart from the fit, a covered hand and a hand without readings are less certain."""
    covered = image.copy()
    covered[:, : int(np.median(np.argwhere(image < 1000)[:, 1]))] = 400

    def judged(readings: np.ndarray, smooth: bool = False, **options: float) -> tuple[float, float]:
        hand = tracked_hand(track(model, readings=readings, **options), model, smooth=smooth, surface=False)
        return hand.confidence, hand.error_mm

    whole, error = judged(image)
    assert whole > 0.9 and error < 20
    for worse in (judged(image, smooth=True, apart=30), judged(covered), judged(EMPTY)):
        assert worse[0] < whole - 0.05 and worse[1] > error + 2
    assert judged(EMPTY)[0] < 0.1
    assert judged(image, smooth=True, apart=0) == pytest.approx((whole, error))


@pytest.mark.parametrize("side", ["right", "left"])
def test_the_error_of_each_finger(model: CapsuleModel, image: np.ndarray, side: Side) -> None:
    """What covers the thumb raises its expected error most; a left hand in a mirrored image has the same."""
    places = model.joints(variables(model)[None])[0] + NYU.unproject(CENTER)
    tip = np.rint(NYU.project(places[model.skeleton.joint_names.index("thumb_tip")])).astype(int)
    covered = image.copy()
    covered[tip[1] - 15 : tip[1] + 15, tip[0] - 15 : tip[0] + 15] = 400

    def errors(readings: np.ndarray) -> np.ndarray:
        center, middle = CENTER, 2 * NYU.u0
        if side == "left":
            columns = np.rint(middle - np.arange(NYU.width)).astype(int).clip(0, NYU.width - 1)
            readings, center = readings[:, columns], CENTER * (-1, 1, 1) + (middle, 0, 0)
        one = track(model, side, readings=readings, center_uvd=center)
        return tracked_hand(one, model, smooth=False, surface=False).finger_error_mm

    whole, worse = errors(image), errors(covered)
    assert whole.shape == (5,) and (whole > 0).all()
    assert worse[0] > 1.3 * whole[0] and (worse[1:] < 1.1 * whole[1:]).all()


def test_errors_that_were_not_measured(model: CapsuleModel) -> None:
    hand = tracked_hand(track(model, readings=None), model, smooth=True, surface=False)
    assert np.isnan([hand.error_mm, hand.confidence, *hand.finger_error_mm]).all()
