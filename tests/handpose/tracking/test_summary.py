"""handpose/tracking/summary.py"""

from __future__ import annotations

import re

import pytest

from handpose.tracking.summary import Summary
from handpose.tracking.track import TrackedHand
from tests.handpose.tracking.conftest import frames_of
from tests.support.tracked_hands import HEADER, lost, present, tracked, with_pose

HERE = tracked()


def summed(*hands: tuple[TrackedHand, ...]) -> Summary:
    """The summary of frames with these hands, two per second from 3 s on."""
    found = Summary(HEADER.skeleton)
    for frame in frames_of(*hands, step=0.5, first=3.0):
        found.add(frame)
    return found


def gone(since: float) -> TrackedHand:
    """The hand while it is lost."""
    return lost(1, since=since)


@pytest.mark.parametrize(("frames", "seconds"), [(0, 0), (3, 1.0)])
def test_frames_and_seconds(frames: int, seconds: float) -> None:
    """Time is counted from the first frame to the last."""
    found = summed(*[()] * frames)
    assert (found.frames, found.seconds, found.hands) == (frames, seconds, {})


def test_losses() -> None:
    """Losses are counted once each, with the longest time since the hand was last seen."""
    found = summed((HERE,), (gone(3),), (gone(3),), (HERE,), (gone(4.5),), (HERE,)).hands[1]
    assert (found.frames, found.losses, found.longest, found.is_lost) == (3, 2, 1.0, False)
    assert summed((HERE,), (gone(3),)).hands[1].is_lost


def test_each_hand_by_itself() -> None:
    """Hands are summarised by id, with their last side and size."""
    left, grown = tracked("left", id=2), with_pose(HERE, bones=HEADER.skeleton.bones * 1.1)
    found = summed((tracked(hand="left"), left), (grown, left), (grown,))
    assert found.rows == [
        ["hand", "frames", "confidence", "size", "lost", "longest"],
        ["1 right", "3", "93%", "1.100", "0", "0.0 s"],
        ["2 left", "2", "93%", "1.000", "0", "0.0 s"],
    ]


def test_the_confidence_is_the_median_of_the_known_ones() -> None:
    hands = [(tracked(confidence=value),) for value in (0.2, 0.9, 0.8, float("nan"))]
    found = [summed(*hands), summed(hands[-1]), summed((gone(1),))]
    assert [one.hands[1].sure for one in found] == ["80%", "unknown", "unknown"]


def test_why_nothing_was_found() -> None:
    """The hands without a sure pose are counted by reason, without the figures in it."""
    cold, colder, late = (
        present(0, 0.5, 0.1, reason=said) for said in ("cold (12%)", "cold (3%)", "late")
    )
    assert summed().nothing_found == "no hand was found: no place looked like one"
    assert summed((cold, late), (colder,)).nothing_found.endswith(": cold (2); late (1)")


@pytest.mark.parametrize(
    ("size", "confidence", "frames", "doubt"),
    [
        (0.8, 0.5, 40, ""),
        (0.95, 0.97, 40, ""),
        (0.95, 0.8, 14, ""),
        (
            0.95,
            0.8,
            40,
            "206 mm from the wrist to the tip of the middle finger, longer ... 20% or more too small",
        ),
        (1.1, 0.97, 40, "239 mm ... longer ... too small"),
        (0.66, 0.97, 40, "143 mm ... shorter ... too large"),
    ],
)
def test_a_size_that_shows_wrong_focal_lengths(
    size: float, confidence: float, frames: int, doubt: str
) -> None:
    hand = with_pose(tracked(confidence=confidence), bones=HEADER.skeleton.bones * size)
    found = summed(*[(hand,)] * frames).doubts
    assert len(found) == bool(doubt)
    assert all(re.fullmatch(f"hand 1: it has {doubt.replace('...', '.*')}", line) for line in found)
