"""handpose/tracking/reporting.py: which hands are reported, in tracks, files and live messages."""

from __future__ import annotations

import csv
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from handpose.body.sides import Side
from handpose.output.tracks.json_values import FrameValues
from handpose.output.tracks.writing import open_writer
from handpose.tracking.reporting import SureHands
from handpose.tracking.settings import TrackSettings
from handpose.tracking.track import TrackedFrame, TrackedHand
from tests.handpose.tracking.conftest import frames_of
from tests.support.tracked_hands import HEADER, facts, lost, present, tracked

SETTINGS = TrackSettings()
MIN_GIVEN = SETTINGS.present.min_given
SURE = replace(tracked(id=0, confidence=0.3), presence=0.8)
UNSURE = replace(tracked(id=0, confidence=0.299), presence=0.7)
GONE = lost(0, since=1.0)


def withheld(hand: TrackedHand) -> TrackedHand:
    """A right hand without its joints."""
    reason = f"the pose is uncertain (confidence {hand.confidence:.0%})"
    return hand.without_pose("right", hand.xyz.mean(axis=0), reason)


def reported(*frames: tuple[TrackedHand, ...]) -> list[TrackedFrame]:
    """Frames with these hands, one per second, after the rule."""
    return [*map(SureHands(0.3, SETTINGS), frames_of(*frames))]


def ids(hands: tuple[TrackedHand, ...]) -> list[int]:
    return [hand.id for hand in hands]


def test_a_hand_that_becomes_unsure() -> None:
    """It is present, and its joints are given again later; the tracker's reason for losing
    it is reported.
    """
    before = MIN_GIVEN - 2
    hands = SURE, UNSURE, UNSURE, SURE, UNSURE, GONE
    frames = reported(*[(SURE,)] * before, *((hand,) for hand in hands))[before:]
    assert [frame.hands for frame in frames] == [(SURE,), (), (), (SURE,), (), ()]
    unsure = facts([withheld(UNSURE)])
    gone = lost(0, since=before + 4.0)
    assert [facts(frame.present) for frame in frames] == [[], unsure, unsure, [], unsure, []]
    assert [facts(frame.lost) for frame in frames] == [[]] * 5 + [facts([gone])]


def test_a_hand_that_was_never_sure() -> None:
    """It is present at the mean of its joints, and is not listed as lost when the
    tracker loses it.
    """
    first, second = reported((UNSURE,), (GONE,))
    assert not first.hands and first.present[0].place == tuple(UNSURE.xyz.mean(axis=0))
    assert second == TrackedFrame(1, 1.0)


@pytest.mark.parametrize("frames", [MIN_GIVEN - 1, MIN_GIVEN])
def test_only_a_hand_that_had_joints_for_some_frames_is_lost(frames: int) -> None:
    *_, last = reported(*[(SURE,)] * frames, (GONE,))
    assert ids(last.lost) == [0] * (frames == MIN_GIVEN)


DOUBTFUL = present(2, 0.6, 0.0, is_sure=False)  # without joints


def test_a_hand_with_joints_hides_present_ones_unless_they_are_sure() -> None:
    sure = replace(DOUBTFUL, id=1, is_sure=True)
    frames = reported((SURE, DOUBTFUL, sure), (UNSURE, DOUBTFUL), (DOUBTFUL,))
    expected = [sure], [withheld(UNSURE), DOUBTFUL], [DOUBTFUL]
    assert [facts(frame.present) for frame in frames] == [facts(hands) for hands in expected]


@pytest.mark.parametrize("later", [(UNSURE,), (GONE,)])
def test_a_recent_hand_with_joints_hides_present_ones(later: tuple[TrackedHand]) -> None:
    """If it had joints for some frames; a hand that had them once hides others only in that
    frame.
    """
    frames = frames_of(
        *[(SURE, DOUBTFUL)] * MIN_GIVEN,
        *[(*later, DOUBTFUL)] * 8,
        step=SETTINGS.follow.recent_s / 4,
    )
    reports = map(SureHands(0.3, SETTINGS), frames)
    counts = [sum(hand.place == DOUBTFUL.place for hand in frame.present) for frame in reports]
    assert counts == [0] * (MIN_GIVEN + 4) + [1] * 4


@pytest.mark.parametrize(
    ("before", "side"), [(SURE, "right"), (replace(SURE, side_confidence=0.6), None)]
)
def test_the_side_that_was_known(before: TrackedHand, side: Side | None) -> None:
    """An unsure hand of an undecided side has the side that it had, if any."""
    _, frame = reported((before,), (replace(UNSURE, side_confidence=0.6),))
    assert frame.present[0].hand == side


def test_each_hand_by_itself() -> None:
    a, b, c = (tracked(id=id) for id in (0, 1, 2))
    other, unsure = withheld(tracked(id=3)), replace(b, confidence=0.4)
    sure = SureHands(0.5, SETTINGS)
    *before, last = frames_of(*[(a, b, c)] * MIN_GIVEN, (unsure, c, lost(0), other))
    assert [*map(sure, before)] == before and not sure.note
    found = sure(last)
    assert found.hands == (c,) and ids(found.lost) == [0]
    assert facts(found.present) == facts([withheld(unsure), other])
    assert sure.frames == 1 and sure.note.startswith(
        "1 frames have a hand with a confidence below 50%"
    )


def test_a_confidence_that_is_unknown_is_not_below() -> None:
    [frame] = frames_of((tracked(id=0, confidence=np.nan),))
    assert SureHands(1.0, SETTINGS)(frame).hands == frame.hands


def test_a_minimum_confidence_of_0_removes_nothing() -> None:
    other = withheld(tracked(id=1))
    [frame] = frames_of((tracked(id=0, confidence=0.0), other))
    assert SureHands(0, SETTINGS)(frame) == frame


@pytest.mark.parametrize("minimum", [0, 0.3])
def test_ids_are_counted_in_the_order_of_first_reports(minimum: float) -> None:
    """In one frame a hand with joints comes before one without; a hand that returns has its id."""
    sure, first, second = replace(DOUBTFUL, id=1, is_sure=True), tracked(id=5), tracked(id=3)
    frames = frames_of(*[(first, sure)] * MIN_GIVEN, (second, sure, lost(5)), (first, second, sure))
    *_, before, without, after = map(SureHands(minimum, SETTINGS), frames)
    assert ids(before.hands) == [0] and ids(before.present) == [1]
    assert ids(without.hands) == [2] and ids(without.lost) == [0]
    assert ids(after.hands) == [0, 2] and ids(after.present) == [1]


def test_unreported_hands_have_no_id() -> None:
    """Neither a place that is hidden by a hand with joints, nor a hand that is lost at once."""
    found = reported((SURE, DOUBTFUL), (SURE, tracked(id=9), replace(GONE, id=7)))
    assert ids(found[1].hands) == [0, 1] and not found[1].lost
    [frame] = frames_of((replace(GONE, id=7),))
    assert not SureHands(0, SETTINGS)(frame).lost


def test_a_hand_of_an_undecided_side_has_its_id_as_either() -> None:
    hand = replace(tracked(id=4), side_confidence=0.6, other=tracked("left", id=4))
    [frame] = reported((hand,))
    assert [frame.hands[0].id, frame.hands[0].other.id] == [0, 0]


def test_no_output_has_the_joints(tmp_path: Path) -> None:
    """Files and messages have the reason in their place."""
    frames = reported((SURE,), (UNSURE,), (replace(UNSURE, id=2),))
    reason = "the pose is uncertain (confidence 30%)"
    values = FrameValues(HEADER)
    hands = [hand for frame in frames for hand in values.values(frame)["hands"]]
    assert [hand["positions_mm"] is None for hand in hands] == [False, True, True]
    assert all(hand["reason"] == reason and "angles_rad" not in hand for hand in hands[1:])
    with open_writer(tmp_path / "t.csv", HEADER) as writer:
        for frame in frames:
            writer.write(frame)
    rows = list(csv.DictReader((tmp_path / "t.csv").read_text().splitlines()))
    assert [row["lost"] for row in rows] == ["", reason, reason]
    for row in rows:
        pose = {value for key, value in row.items() if key.endswith(("_mm", "_rad"))}
        assert (pose == {""}) == (row["lost"] == reason)
