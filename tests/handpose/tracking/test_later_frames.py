"""handpose/tracking/later_frames.py: sides decided later; recordings of a moving, a trembling and
a missing hand
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from handpose.body.sides import SIDES, Side, mirror_of
from handpose.fit.body import SIZE_INDEX, CapsuleModel, crop_variables, world_pose
from handpose.fit.pose_confidence import GOOD_MM
from handpose.tracking.later_frames import LOOKAHEAD_FRAMES, MAX_UNDECIDED_S, LaterFrames
from handpose.tracking.settings import LaterSettings, SmoothSettings
from handpose.tracking.smoothing import PoseFilter
from handpose.tracking.track import TrackedFrame, TrackedHand, TrackedPoses, joints_of
from tests.handpose.tracking.conftest import frames_of
from tests.support.tracked_hands import HEADER, present, tracked, with_pose

RATE = 30.0
LATER = LaterSettings()
ORIGIN = np.array([20.0, -30, 700])


def take(
    model: CapsuleModel,
    poses: np.ndarray,
    side: Side = "right",
    size: float | None = None,
    missing: Sequence[int] = (),
) -> list[TrackedFrame]:
    """A track of one hand with these variables (N, V), smoothed by a tracker; some frames
    are without it.
    """
    pose_filter = PoseFilter(SmoothSettings())
    hands: list[tuple[TrackedHand, ...]] = []
    for n, x in enumerate(poses):
        if n in missing:
            hands.append(())
            continue
        fitted = world_pose(model, x, ORIGIN * mirror_of(side))
        followed = TrackedPoses(fitted, pose_filter(fitted, n / RATE), 5.0, size)
        hands.append((with_pose(tracked(side), origin_mm=ORIGIN, followed=followed),))
    return frames_of(*hands, step=1 / RATE)


def smoothed(model: CapsuleModel, frames: list[TrackedFrame]) -> list[TrackedFrame]:
    """All frames, smoothed."""
    later = LaterFrames[int](model)
    released = [pair for frame in frames for pair in later.add(frame.number, frame)]
    released += later.finish()
    assert [item for item, _ in released] == [frame.number for frame in frames]
    return [frame for _, frame in released]


def variables_of(model: CapsuleModel, hand: TrackedHand) -> np.ndarray:
    """The variables (1, V) of the smoothed pose of a hand."""
    smooth = hand.pose.followed.smoothed
    return crop_variables(model, smooth, ORIGIN * mirror_of(hand.hand))[None]


def joints(model: CapsuleModel, frames: list[TrackedFrame]) -> tuple[np.ndarray, np.ndarray]:
    """The joints (N, K, 3) in mm of the only hand as the tracker smoothed it, and
    with later frames.
    """
    before = np.stack(
        [model.joints(variables_of(model, frame.hands[0]))[0] + ORIGIN for frame in frames]
    )
    return before, np.stack([frame.hands[0].xyz for frame in smoothed(model, frames)])


def swinging(model: CapsuleModel) -> np.ndarray:
    """Variables (120, V) of fingers that close and open once per second, in a palm that swings by
    100 mm and turns.
    """
    phase = 2 * np.pi * np.arange(120) / RATE
    x = np.zeros((120, model.variables))
    x[:, 0] = 0.05 / 0.15 * np.sin(phase)
    x[:, 5] = 0.2 * np.sin(phase)
    bent = 0.3 + 0.3 * np.sin(phase)[:, None]
    x[:, model.limbs] = np.clip(bent, model.lower[model.limbs], model.upper[model.limbs])
    return x


def undecided(right: float) -> TrackedHand:
    """A hand that is a right one with this probability, and its other side."""
    one, two = (
        replace(tracked(side), confidence=0.8 * likely, side_confidence=likely)
        for side, likely in zip(SIDES, (right, 1 - right))
    )
    return replace(one, other=two) if right >= 0.5 else replace(two, other=one)


def test_a_later_decision_is_used(model: CapsuleModel) -> None:
    """Frames in which the other side was assumed get the pose of the decided one."""
    frames = frames_of((undecided(0.8),), (undecided(0.4),), (tracked("left"),), step=0.1)
    for frame in smoothed(model, frames):
        (hand,) = frame.hands
        assert hand.known_side == "left" and hand.other is None
        assert hand.confidence == tracked("left").confidence or abs(hand.confidence - 0.8) < 1e-9


def test_frames_wait_for_a_decision(model: CapsuleModel) -> None:
    """Frames before it wait, also those of other hands; after some seconds they are released with
    an unknown side.
    """
    one = LaterFrames[int](model)
    given = frames_of((tracked("right"),), *[(undecided(0.5),)] * 9, step=MAX_UNDECIDED_S / 2)
    ready = [[found.number for _, found in one.add(0, frame)] for frame in given]
    assert ready == [[], [], [], [], [0], [1], [2], [3], [4], [5]]
    assert [hand.known_side for _, frame in one.finish() for hand in frame.hands] == [None] * 4


@pytest.mark.parametrize(("right", "side"), [(0.95, "right"), (0.55, None)])
def test_the_end_of_a_recording(model: CapsuleModel, right: float, side: Side | None) -> None:
    """At the end, a likely side is used for the frames that are still held; an unlikely one
    remains unknown.
    """
    found = smoothed(model, frames_of((undecided(0.6),), (undecided(right),), step=0.1))
    assert [hand.known_side for frame in found for hand in frame.hands] == [side, side]


@pytest.mark.parametrize("later", ["sure", "posed", "neither"])
def test_a_hand_is_present_that_is_sure_later(model: CapsuleModel, later: str) -> None:
    """It is reported beside a hand with joints from its first frame on."""
    doubtful, sure = (present(7, 0.5, 0.0, is_sure=is_sure) for is_sure in (False, True))
    last = {"sure": sure, "posed": tracked(id=7), "neither": doubtful}[later]
    one = LaterFrames[None](model, min_confidence=0.3)
    for frame in frames_of((tracked(), doubtful), (tracked(), last), step=1 / RATE):
        assert not one.add(None, frame)
    first, _ = (frame for _, frame in one.finish())
    assert [hand.place for hand in first.present] == [doubtful.place] * (later != "neither")


def test_a_moving_hand_is_followed_without_lag(model: CapsuleModel) -> None:
    """The error of smoothing is less than half of that of the filter that knows
    earlier frames only.
    """
    x = swinging(model)
    true = model.joints(x) + ORIGIN
    before, after = (
        np.linalg.norm(xyz - true, axis=2)[30:-30].mean() for xyz in joints(model, take(model, x))
    )
    assert after < 0.5 * before


def test_a_trembling_hand_becomes_steadier(model: CapsuleModel) -> None:
    """The deviation at rest is smaller than that of the tracker's smoothing."""
    noise = np.random.default_rng(0).normal(0, 0.004, (120, model.variables))
    noise[:, SIZE_INDEX:] = 0
    before, after = (
        xyz[30:-30].std(axis=0).mean() for xyz in joints(model, take(model, 0.1 + noise))
    )
    assert after < 0.9 * before


@pytest.mark.parametrize("side", SIDES)
def test_the_values_of_a_hand_agree(model: CapsuleModel, side: Side) -> None:
    """Joints follow from inputs, bones and origin; bones keep the known size; the surface moves
    with the pose.
    """
    frames = smoothed(model, take(model, swinging(model), side, size=0.9))
    for frame in frames[::40]:
        (hand,) = frame.hands
        pose = hand.pose
        values = pose.inputs, pose.bones, pose.origin_mm
        by_values = joints_of(HEADER.skeleton, HEADER.unit_mm, side, *values)
        np.testing.assert_allclose(hand.xyz, by_values, atol=1e-6)
        np.testing.assert_allclose(pose.bones, 0.9 * model.skeleton.bones)
        x = variables_of(model, hand)
        x[:, SIZE_INDEX] = np.log(0.9)
        mirror = mirror_of(side)[None]
        expected = model.capsules(x, ORIGIN * mirror).mirrored(mirror)
        np.testing.assert_allclose(pose.capsules.a, expected.a, atol=1e-4)


def test_frames_are_held_for_a_limited_time(model: CapsuleModel) -> None:
    """A frame waits for twice the time ahead at most, and for a limited number of frames."""
    for rate, most in ((RATE, 2 * LATER.lookahead_s * RATE + 1), (1000.0, 2 * LOOKAHEAD_FRAMES)):
        one, waiting = LaterFrames[int](model), 0
        for n in range(400):
            waiting += 1 - len(one.add(n, TrackedFrame(n, n / rate)))
            assert waiting <= most
    assert len(one.finish()) == waiting and one.finish() == []


def test_a_missing_hand_is_not_smoothed_across(model: CapsuleModel) -> None:
    """A pose before a gap does not depend on the poses after it."""
    x = swinging(model)
    other = x.copy()
    other[61:, model.limbs] = 0.0
    first, second = (smoothed(model, take(model, poses, missing=[60])) for poses in (x, other))
    assert not first[60].hands
    for n in range(60):
        np.testing.assert_array_equal(first[n].hands[0].xyz, second[n].hands[0].xyz)
    assert np.abs(first[62].hands[0].xyz - second[62].hands[0].xyz).max() > 1


def test_hands_that_were_not_smoothed_are_unchanged(model: CapsuleModel) -> None:
    """Raw poses, and those of other sources, pass."""
    frames = frames_of(*[(tracked(id=0),)] * 5, step=1 / RATE)
    for found, given in zip(smoothed(model, frames), frames):
        assert found.hands[0] is given.hands[0]


def test_errors_and_confidences_are_averaged_over_time(model: CapsuleModel) -> None:
    """Expected errors are means over half a second before and after, and the confidence is
    that mean at most.
    """
    hands = []
    for n, frame in enumerate(take(model, np.zeros((90, model.variables)))):
        error, confidence = (40.0, 0.2) if 40 <= n < 42 else (10.0, 0.9)
        own = replace(
            frame.hands[0],
            error_mm=error,
            confidence=confidence,
            finger_error_mm=np.full(5, 2 * error),
        )
        # another hand changes nothing
        hands.append((own, replace(own, id=7, error_mm=90.0, confidence=0.0)))
    found = [frame.hands[0] for frame in smoothed(model, frames_of(*hands, step=1 / RATE))]
    averaged = round(2 * LATER.lasting_s * RATE) + 1  # frames
    near = 10 + 60 / averaged, 0.9 - 1.4 / averaged
    expected = {20: (10, 0.9), 38: near, 40: (GOOD_MM * 0.8, 0.2)}
    for n, values in expected.items():
        assert (found[n].error_mm, found[n].confidence) == pytest.approx(values)
    assert found[40].finger_error_mm.tolist() == [80] * 5
