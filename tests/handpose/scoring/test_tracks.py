"""handpose/scoring/tracks.py and matching.py, on tracks with known figures."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from handpose.frames.cameras import NYU
from handpose.scoring.tracks import score
from handpose.tracking.track import HIDDEN, LEFT, PARTLY, LostHand, TrackedFrame, TrackedHand, TrackHeader
from layers.hand import skeleton as skeletons
from netlib.blob import Array
from netlib.errors import DataError
from tests.support.bad_input import bad_inputs

SKELETON = skeletons.load()
HEADER = TrackHeader("made up", NYU, SKELETON)
BASE = np.random.default_rng(0).uniform(-80, 80, (31, 3)) + (0, 0, 600)
RIGHT, OTHER = np.array([-200.0, 0, 0]), np.array([200.0, 0, 0])  # the positions of the two hands


def hand(id: int, place: Array, side: str = "right", time: float = 0.0) -> TrackedHand:
    """A hand that moves back and forth about a place."""
    xyz = BASE + place + np.array([30.0, 20, 0]) * np.sin(4 * time)
    nothing = np.zeros(3)
    return TrackedHand(id, side, 1.0, 0.0, np.zeros(47), np.zeros(31), nothing, xyz, nothing, 300.0)


def frames(hands: Sequence[Sequence[TrackedHand]], lost: Sequence[Sequence[LostHand]] = ()) -> list[TrackedFrame]:
    """Frames 0, 1, ... with these hands, at 30 frames/s."""
    return [TrackedFrame(n, n / 30, tuple(own), tuple(lost[n]) if lost else ()) for n, own in enumerate(hands)]


def moved(one: TrackedHand, *by: float) -> TrackedHand:
    """The same hand, shifted by this many mm."""
    return replace(one, xyz=one.xyz + np.array(by))


TRUTH = frames([[hand(0, RIGHT, "right", n / 30), hand(1, OTHER, "left", n / 30)] for n in range(90)])


def test_the_truth_is_without_fault() -> None:
    """The truth compared with itself has no errors."""
    scores = score(HEADER, TRUTH, TRUTH)
    assert scores.found == 1 and scores.invented == 0 and scores.id_switches == 0 and scores.frames == 90
    for own in scores.hands.values():
        assert own.missed == own.wrong_side == own.gone == 0
        assert own.errors.mean == own.errors14.median == 0
        assert own.lag_ms == pytest.approx(0, abs=0.01)
        assert max(own.bone_change_mm) < 1e-9 and np.isnan(own.jitter_mm)


def test_errors() -> None:
    """A shift by 3, 4 and 0 mm is an error of 5 mm; one of 31 joints contributes a 31st to the mean."""
    tracked = [frame._replace(hands=tuple(moved(one, 3, 4, 0) for one in frame.hands)) for frame in TRUTH]
    assert score(HEADER, tracked, TRUTH).hands[0].errors.mean == pytest.approx(5)
    assert score(HEADER, tracked, TRUTH).hands[1].errors14.median == pytest.approx(5)
    off = np.zeros((31, 3))
    off[1, 0] = 31  # little_dip, which is not among the 14
    tracked = [frame._replace(hands=tuple(replace(one, xyz=one.xyz + off) for one in frame.hands)) for frame in TRUTH]
    own = score(HEADER, tracked, TRUTH).hands[0]
    assert own.errors.mean == pytest.approx(1) and own.errors.median == 0 and own.errors14.mean == 0


def test_ids_may_have_any_number_but_must_not_change() -> None:
    """Ids swapped halfway are two switches; the order of the hands within a frame does not matter."""
    tracked = [
        frame._replace(hands=tuple(replace(one, id=7 + (one.id + (frame.number >= 40)) % 2) for one in frame.hands))
        for frame in TRUTH
    ]
    reversed_ = [frame._replace(hands=frame.hands[::-1]) for frame in tracked]
    for track in (tracked, reversed_):
        scores = score(HEADER, track, TRUTH)
        assert scores.found == 1 and scores.id_switches == 2
        assert [own.id_switches for own in scores.hands.values()] == [1, 1]


def test_sides() -> None:
    sides = ["left"] * 3 + ["right"] * 50 + ["left"] + ["right"] * 36
    tracked = frames([[hand(0, RIGHT, side, n / 30)] for n, side in enumerate(sides)])
    own = score(HEADER, tracked, TRUTH).hands[0]
    assert (own.wrong_side, own.side_switches) == (4, 3)


def test_a_hand_far_from_all_is_invented() -> None:
    """A hand farther than the bound counts as invented, and the true one as missed."""
    tracked = [frame._replace(hands=(moved(frame.hands[0], 0, 0, 120),)) for frame in TRUTH]
    scores = score(HEADER, tracked, TRUTH)
    assert scores.found == 0 and scores.invented == 90
    assert scores.hands[0].missed == scores.hands[1].missed == 90 and scores.hands[0].bone_change_mm == ()
    assert np.isnan(scores.hands[0].errors.mean)
    assert score(HEADER, tracked, TRUTH, bound_mm=150).found == 0.5


def test_lost_hands() -> None:
    """Hands out of sight should be reported as lost, with the reason; those partly in sight are not scored."""
    here = hand(0, RIGHT)
    reasons = ["", "", PARTLY, LEFT, LEFT, LEFT, HIDDEN, PARTLY, "", ""]
    truth = frames([[] if why else [here] for why in reasons],
                   [[LostHand(0, "right", 1 / 30, why)] if why else [] for why in reasons])
    said = ["", "", "", "", LEFT, "nothing like a hand there", "hidden by another hand", "", "no hand", ""]
    shown = [True, True, True, True, False, False, False, False, False, True]
    tracked = frames([[hand(5, RIGHT)] if there else [] for there in shown],
                  [[LostHand(5, "right", 0.1, why)] if why else [] for why in said])
    scores = score(HEADER, tracked, truth)
    own = scores.hands[0]
    assert (own.in_sight, own.found, own.said_lost) == (4, 3, 1)
    assert (own.gone, own.said_gone, own.right_reason) == (4, 3, 2)
    assert scores.invented == 1  # in frame 3, not in frame 2


def test_a_track_that_ends_early_misses_the_rest() -> None:
    """Frames missing at the end count as frames without hands."""
    assert score(HEADER, TRUTH[:30], TRUTH).found == pytest.approx(1 / 3)


def test_no_hands_at_all() -> None:
    """Without hands in the truth, the fraction found is NaN, and tracked hands count as invented."""
    empty = frames([[], []])
    scores = score(HEADER, empty, empty)
    assert scores.hands == {} and np.isnan(scores.found) and scores.invented == 0
    assert score(HEADER, TRUTH[:2], empty).invented == 4


SHORT = [TRUTH[0]._replace(hands=(replace(TRUTH[0].hands[0], xyz=BASE[:21]),))]


@bad_inputs(DataError, {
    "missing": (lambda: score(HEADER, TRUTH, TRUTH[:30]),
                "frame 30 of the track is not in the truth; expected a track of the same recording"),
    "twice": (lambda: score(HEADER, [TRUTH[0], TRUTH[0]], TRUTH), "the track has two frames 0; expected one"),
    "21 joints": (lambda: score(HEADER, SHORT, TRUTH),
                  "a track of joints (21, 3), its truth has (31, 3); expected one skeleton"),
})
def test_what_cannot_be_compared(given: Callable[[], object], rejected: Any) -> None:
    """Frames missing in the truth, repeated frames and other skeletons raise errors."""
    with rejected:
        given()
