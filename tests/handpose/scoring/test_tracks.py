"""handpose/scoring/tracks.py"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import ArrayLike

from handpose.frames.cameras import NYU
from handpose.scoring.tracks import jitter, lag_s, rests, score
from handpose.tracking.track import LEFT, PARTLY, HandPose, TrackedFrame, TrackedHand, TrackHeader
from layers.hand import skeleton as skeletons
from netlib.blob import Array
from netlib.errors import DataError
from tests.support.bad_input import bad_inputs
from tests.support.tracked_hands import lost, with_pose

SKELETON = skeletons.load()
HEADER = TrackHeader("made up", NYU, SKELETON)
BASE = np.random.default_rng(0).uniform(-80, 80, (31, 3)) + (0, 0, 600)
RIGHT, OTHER = np.array([-200.0, 0, 0]), np.array([200.0, 0, 0])  # the positions of the two hands


def hand(id: int, place: Array, side: str = "right", time: float = 0.0) -> TrackedHand:
    """A hand that moves back and forth about a place."""
    xyz = BASE + place + np.array([30.0, 20, 0]) * np.sin(4 * time)
    nothing = np.zeros(3)
    pose = HandPose(SKELETON, side, np.zeros(47), np.zeros(31), nothing, xyz, nothing, 300.0)
    return TrackedHand(id, side, 1.0, 0.0, pose)


def frames(hands: Sequence[Sequence[TrackedHand]]) -> list[TrackedFrame]:
    """Frames 0, 1, ... with these hands, at 30 frames/s."""
    return [TrackedFrame(n, n / 30, tuple(own)) for n, own in enumerate(hands)]


def moved(one: TrackedHand, by: ArrayLike) -> TrackedHand:
    """The same hand, shifted by this many mm."""
    return with_pose(one, xyz=one.xyz + np.array(by))


def two_hands(time: float) -> list[TrackedHand]:
    return [hand(0, RIGHT, "right", time), hand(1, OTHER, "left", time)]


TRUTH = frames([two_hands(n / 30) for n in range(90)])


def each(change: Callable[[TrackedHand, int], TrackedHand]) -> list[TrackedFrame]:
    """The truth with a change of each hand, which depends on the number of the frame."""
    return frames([[change(one, frame.number) for one in frame.hands] for frame in TRUTH])


def test_the_truth_is_without_fault() -> None:
    scores = score(HEADER, TRUTH, TRUTH)
    assert scores.found == 1 and scores.invented == 0 and scores.frames == 90
    for own in scores.hands.values():
        assert own.missed == own.wrong_side == own.id_switches == own.error_mm == 0
        assert own.lag_ms == pytest.approx(0, abs=0.01)
        assert np.isnan(own.jitter_mm)


def test_errors() -> None:
    """A shift by 3, 4 and 0 mm is an error of 5 mm; one of 31 joints contributes a
    31st to the mean.
    """
    off = np.zeros((31, 3))
    off[1, 0] = 31
    for by, error in (((3, 4, 0), 5), (off, 1)):
        tracked = each(lambda one, number, by=by: moved(one, by))
        assert score(HEADER, tracked, TRUTH).hands[0].error_mm == pytest.approx(error)


def test_ids_may_have_any_number_but_must_not_change() -> None:
    """Ids swapped halfway are two switches; the order of the hands within a frame
    does not matter.
    """

    def swapped_later(one: TrackedHand, number: int) -> TrackedHand:
        return replace(one, id=7 + (one.id + (number >= 40)) % 2)

    tracked = each(swapped_later)
    reversed_ = [frame._replace(every=frame.every[::-1]) for frame in tracked]
    for track in (tracked, reversed_):
        scores = score(HEADER, track, TRUTH)
        assert scores.found == 1
        assert [own.id_switches for own in scores.hands.values()] == [1, 1]


def test_sides() -> None:
    sides = ["left"] * 3 + ["right"] * 50 + ["left"] + ["right"] * 36
    tracked = frames([[hand(0, RIGHT, side, n / 30)] for n, side in enumerate(sides)])
    own = score(HEADER, tracked, TRUTH).hands[0]
    assert (own.wrong_side, own.side_switches) == (4, 3)


def test_a_hand_far_from_all_true_ones_counts_as_invented() -> None:
    tracked = frames([[moved(frame.hands[0], (0, 0, 120))] for frame in TRUTH])
    scores = score(HEADER, tracked, TRUTH)
    assert scores.found == 0 and scores.invented == 90
    assert scores.hands[0].missed == scores.hands[1].missed == 90
    assert np.isnan(scores.hands[0].error_mm)


def test_hands_partly_in_sight_are_not_scored() -> None:
    here = hand(0, RIGHT)
    reasons = ["", "", PARTLY, LEFT, PARTLY, "", ""]
    truth = frames([[lost(0, reason=why) if why else here] for why in reasons])
    found = [hand(5, RIGHT)]
    tracked = frames([found, found, found, found, [], [], found])
    scores = score(HEADER, tracked, truth)
    assert (scores.hands[0].in_sight, scores.hands[0].found) == (4, 3)
    assert scores.invented == 1  # in frame 3, not in frame 2


def test_no_hands_at_all() -> None:
    """Frames without hands have no scores; a track that ends early misses the rest."""
    assert score(HEADER, TRUTH[:30], TRUTH).found == pytest.approx(1 / 3)
    empty = frames([[], []])
    scores = score(HEADER, empty, empty)
    assert scores.hands == {} and np.isnan(scores.found) and scores.invented == 0
    assert score(HEADER, TRUTH[:2], empty).invented == 4


SHORT = frames([[with_pose(TRUTH[0].hands[0], xyz=BASE[:21])]])


@bad_inputs(
    DataError,
    {
        "missing": (
            lambda: score(HEADER, TRUTH, TRUTH[:30]),
            "frame 30 of the track is not in the truth; expected a track of the same recording",
        ),
        "twice": (
            lambda: score(HEADER, [TRUTH[0], TRUTH[0]], TRUTH),
            "the track has two frames 0; expected one",
        ),
        "21 joints": (
            lambda: score(HEADER, SHORT, TRUTH),
            "a track of joints (21, 3), its truth has (31, 3); expected one skeleton",
        ),
    },
)
def test_tracks_that_do_not_match_the_truth_are_rejected(
    given: Callable[[], object], rejected: Any
) -> None:
    """Frames missing in the truth, repeated frames and other skeletons raise errors."""
    with rejected:
        given()


RATE = 30.0
NUMBERS = np.arange(300)
TIMES = NUMBERS / RATE


def moving(times: Array) -> Array:
    """Joints (N, 31, 3) of a hand that moves back and forth."""
    phase = np.sin(2 * np.pi * 0.7 * times)
    return np.asarray(BASE + phase[:, None, None] * (120, 60, 40))


@pytest.mark.parametrize("lag", [0.0, 0.04, 0.0123, -0.025])
def test_the_lag_of_a_track_is_measured(lag: float) -> None:
    """The lag is in seconds, more finely than a frame; a constant error does not affect it."""
    late = moving(TIMES - lag) + (3, -4, 5)
    assert lag_s(NUMBERS, TIMES, late, moving(TIMES)) == pytest.approx(lag, abs=1e-4)


def test_lag_with_noise_and_holes() -> None:
    """The lag is also found with noise, and with missing frames, which split the track."""
    kept = np.r_[0:120, 130:300]
    late = moving(TIMES - 0.04) + np.random.default_rng(1).normal(0, 2, (300, 31, 3))
    assert lag_s(NUMBERS[kept], TIMES[kept], late[kept], moving(TIMES)[kept]) == pytest.approx(
        0.04, abs=5e-4
    )


def test_the_lag_of_a_hand_at_rest_is_nan() -> None:
    """So is that of a very short track, or one out of range."""
    still = np.broadcast_to(BASE, (300, 31, 3))
    assert np.isnan(lag_s(NUMBERS, TIMES, still, still))
    assert np.isnan(lag_s(NUMBERS, TIMES, moving(TIMES - 0.35), moving(TIMES)))
    three = moving(TIMES[:3])
    assert np.isnan(lag_s(NUMBERS[:3], TIMES[:3], three, three))


def test_jitter_by_hand() -> None:
    """With every other frame moved by 1 mm, a window of 15 frames has 7 of them, and the figures
    follow by hand.
    """
    still = np.broadcast_to(BASE, (42, 31, 3))
    tracked = still.copy()
    tracked[::2, :, 0] += 1.0
    found = jitter(np.arange(42), np.arange(42) / RATE, tracked, still)
    squares = 15 * (7 / 15) * (8 / 15)
    assert found == pytest.approx((2 * squares / 28) ** 0.5)


def test_drift_and_movement_are_no_jitter() -> None:
    """Drift, and the error while the hand comes to rest, are not jitter; without a rest the
    figure is NaN.
    """
    times = np.arange(600) / RATE
    stops = moving(np.minimum(times, 5.0))
    late = moving(np.minimum(times - 0.1, 5.0))
    assert rests(np.arange(600), stops) == [(150, 600)]
    assert jitter(np.arange(600), times, late + times[:, None, None], stops) < 0.3
    assert jitter(np.arange(600), times, late, stops) == pytest.approx(0.0, abs=1e-9)
    assert np.isnan(jitter(NUMBERS, TIMES, moving(TIMES), moving(TIMES)))
    single = moving(TIMES[:1])
    assert np.isnan(jitter(NUMBERS[:1], TIMES[:1], single, single))


def test_a_missing_frame_ends_a_rest() -> None:
    still = np.broadcast_to(BASE, (4, 31, 3))
    assert rests(np.array([0, 1, 3, 4]), still) == [(0, 2), (2, 4)]
