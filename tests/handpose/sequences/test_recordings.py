"""handpose/sequences/recordings.py"""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from handpose.body.capsules import in_front
from handpose.frames.cameras import ICVL, NYU, SR305, VIEWS, Camera
from handpose.scoring.tracks import score
from handpose.sequences.recordings import SCRIPTS, SyntheticRecording, render_image
from handpose.tracking.track import LEFT, PARTLY, joints_of
from netlib.errors import DataError
from tests.support.tracked_hands import facts


def test_frames_are_the_same_every_time() -> None:
    """Frames do not depend on the order of access; noise differs between frames, and recordings
    between seeds.
    """
    recording, again = (SyntheticRecording("rest", ICVL, seconds=0.1, seed=3) for _ in range(2))
    once = list(recording)
    twice = [again.frame(n) for n in (2, 1, 0)][::-1]
    assert recording.count == 3 and [frame.number for frame in once] == [0, 1, 2]
    assert [frame.time for frame in once] == [0, 1 / 30, 2 / 30]
    for one, two in zip(once, twice):
        assert_array_equal(one.depth, two.depth)
        assert one.depth.dtype == np.float32 and one.depth.shape == (240, 320)
    assert not np.array_equal(once[0].depth, once[1].depth)
    other = SyntheticRecording("rest", ICVL, seconds=0.1, seed=4)
    assert not np.array_equal(once[0].depth, other.frame(0).depth)


def test_the_hands_are_those_of_people() -> None:
    """Recordings show the hand that is tracked, with other proportions."""
    recording = SyntheticRecording("rest", ICVL, seconds=0.1)
    assert recording.header.skeleton.name == "people"
    model, shown = recording.header.skeleton.bones, recording.truth(0).hands[0].pose.bones
    sizes = shown[model > 0] / model[model > 0]
    assert np.ptp(sizes) > 0.1 * sizes.mean()


def test_a_camera_keeps_its_noise_and_its_background() -> None:
    """The noise level is drawn once per recording, so that all frames of a still hand are
    equally noisy.
    """
    recording = SyntheticRecording("rest", ICVL, seconds=0.4)
    assert recording.sensor
    assert recording.sensor.depth_noise[0] == recording.sensor.depth_noise[1] > 0
    clean = SyntheticRecording("rest", ICVL, seconds=0.4, clean=True)
    truth = clean.frame(0).depth
    off = np.abs(np.stack([frame.depth for frame in recording]) - truth)[:, truth > 0]
    noise = np.mean(off, axis=1, where=off < 10)  # away from edges
    assert noise.max() < 1.2 * noise.min() and noise.min() > 0.1
    assert all(np.array_equal(frame.depth, truth) for frame in clean)


def test_the_truth_is_what_is_seen() -> None:
    """The rendered surface of the truth equals the depth of an ideal camera; joints are those
    of the inputs.
    """
    for script in ("moving", "left"):
        recording = SyntheticRecording(script, NYU, seconds=4, rate=1, clean=True)
        header = recording.header
        for frame, truth in zip(recording, recording.truths()):
            (hand,) = truth.hands
            assert hand.hand == ("left" if script == "left" else "right")
            assert hand.confidence == 1
            pose, surface = hand.pose, hand.pose.capsules
            alone = render_image(in_front(surface), NYU, np.inf)[0]
            seen = np.isfinite(alone)
            near = np.abs(frame.depth - alone)[seen] <= 0.5  # except for the sleeve
            assert near.mean() > 0.6 and (frame.depth[seen] <= alone[seen] + 0.5).all()
            xyz = joints_of(
                header.skeleton, header.unit_mm, hand.hand, pose.inputs, pose.bones, pose.origin_mm
            )
            assert_allclose(xyz, hand.xyz, atol=1e-9)
            assert_allclose(pose.center_uvd, NYU.project(pose.origin_mm))
            ends = np.hstack([surface.a, surface.b])[0]
            radii = np.hstack([surface.radius_a, surface.radius_b])[0]
            # also of a left hand
            assert (np.linalg.norm(xyz[:, None] - ends, axis=2) < radii + 15).any(axis=1).all()


def test_rate_and_length_do_not_change_the_movement() -> None:
    slow, fast = (
        SyntheticRecording("moving", ICVL, rate=rate, seconds=1, clean=True) for rate in (10, 60)
    )
    longer = SyntheticRecording("moving", ICVL, rate=10, seconds=3, clean=True)
    assert_array_equal(slow.frame(8).depth, fast.frame(48).depth)
    assert_array_equal(slow.frame(8).depth, longer.frame(8).depth)


def test_a_hand_that_leaves_is_lost_until_it_returns() -> None:
    """The states are in sight, partly, gone, partly, in sight; ``since`` does not depend on the
    order of access.
    """
    recording = SyntheticRecording("leaves", ICVL, seconds=9, rate=20)
    truths = list(recording.truths())
    states = [truth.lost[0].reason if truth.lost else "" for truth in truths]
    assert [state for state, _ in itertools.groupby(states)] == ["", PARTLY, LEFT, PARTLY, ""]
    gone = states.index(LEFT)
    last = max(n for n in range(gone) if truths[n].hands)
    assert truths[gone].lost[0].since == pytest.approx(last / 20) and not truths[gone].hands
    again = SyntheticRecording("leaves", ICVL, seconds=9, rate=20)
    assert facts(again.truth(gone + 5).lost) == facts(truths[gone + 5].lost)


def test_two_hands() -> None:
    """They have equal bones; each hand stays in its half, the right one on the
    left in the image.
    """
    one = SyntheticRecording("two_hands", ICVL, rate=1, seconds=8)
    for truth in one.truths():
        right, left = truth.hands
        assert (right.hand, left.hand) == ("right", "left") and right.id == 0 and left.id == 1
        assert_array_equal(right.pose.bones, left.pose.bones)
        assert right.pose.center_uvd[0] < 160 < left.pose.center_uvd[0]
    other = SyntheticRecording("two_hands", ICVL, rate=2, seconds=1, mirrored=True).truth(0).hands
    assert [hand.hand for hand in other] == ["left", "right"]
    assert other[0].pose.center_uvd[0] > other[1].pose.center_uvd[0]


def test_a_body_stands_behind() -> None:
    body, arms = (
        SyntheticRecording(replace(SCRIPTS["rest"], body=own), NYU, rate=1, clean=True)
        for own in (True, False)
    )
    seen = body.frame(0).depth
    assert ((seen > 700) & (seen < 1100)).mean() > 0.1
    arm = arms.frame(0).depth
    assert ((arm > 700) & (arm < 1100)).mean() < 0.1


@pytest.mark.parametrize("name", SCRIPTS)
def test_scripts(name: str) -> None:
    """Every script begins with a hand in sight, keeps it so for most of the time, and scores
    perfectly on itself.
    """
    recording = SyntheticRecording(name, ICVL, rate=1)
    truths = list(recording.truths())
    assert len(truths) == recording.count == SCRIPTS[name].seconds
    assert truths[0].hands and np.mean([bool(truth.hands) for truth in truths]) > 0.6
    scores = score(recording.header, truths, truths)
    assert scores.found == 1 and scores.invented == 0
    if name == "minute":
        assert {len(truth.hands) for truth in truths} >= {0, 1, 2}
        first = next(n for n, truth in enumerate(truths) if len(truth.hands) == 2)
        never = {lost.reason for truth in truths[:first] for lost in truth.lost if lost.id == 1}
        assert never <= {PARTLY}  # a hand that never was there is not lost
    if name != "leaves":
        partly = sum(lost.reason == PARTLY for truth in truths for lost in truth.lost)
        assert partly < 0.15 * len(truths)


def test_cameras() -> None:
    own = SyntheticRecording("rest", Camera("own", 400, 400, 100, 90, 0, 0), seconds=0.1)
    assert own.frame(0).depth.shape == (180, 200) and own.truth(0).hands
    coded = SyntheticRecording("rest", SR305, seconds=0.1)
    stored = coded.frame(0).depth / coded.unit_mm
    assert coded.unit_mm == 0.125
    assert_array_equal(stored, np.rint(stored))


def test_a_model_of_camera() -> None:
    """It has 640 x 480 pixels, if its frames have this shape."""
    assert SyntheticRecording("rest", VIEWS["d435"], seconds=0.1).frame(0).depth.shape == (480, 640)
    with pytest.raises(DataError, match="frames of 640 x 480 px; depth frames of azure are"):
        SyntheticRecording("rest", VIEWS["azure"])


@pytest.mark.parametrize("u0", [-3.0, 0.0, 1e6])
def test_a_camera_without_a_plausible_size(u0: float) -> None:
    line = f"^camera own: images of {2 * u0:.0f} x 480 pixels; expected 1 to 16384 each way "
    with pytest.raises(DataError, match=line):
        SyntheticRecording("rest", Camera("own", 500, 500, u0, 240, 0, 0))
