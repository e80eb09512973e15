"""handpose/tracking/summary.py"""

from __future__ import annotations

import re
from dataclasses import replace

import pytest

from handpose.tracking.summary import Summary
from handpose.tracking.track import LostHand, PresentHand, TrackedFrame, TrackedHand
from tests.support.tracked_hands import HEADER, tracked


def summed(*hands: tuple[TrackedHand | LostHand, ...], first: float = 3.0) -> Summary:
    """The summary of frames with these hands, two per second."""
    found = Summary(HEADER.skeleton)
    for n, own in enumerate(hands):
        seen = tuple(one for one in own if isinstance(one, TrackedHand))
        found.add(TrackedFrame(n, first + n / 2, seen, tuple(one for one in own if isinstance(one, LostHand))))
    return found


def gone(since: float, id: int = 1) -> LostHand:
    """A lost hand."""
    return LostHand(id, "right", since, "hidden")


def test_nothing() -> None:
    """A summary without frames has no hands."""
    found = summed()
    assert (found.frames, found.seconds, found.hands) == (0, 0, {})


def test_frames_and_seconds() -> None:
    """Time is counted from the first frame to the last."""
    found = summed((), (), ())
    assert (found.frames, found.seconds, found.hands) == (3, 1.0, {})


def test_losses() -> None:
    """Losses are counted once each, with the longest time since the hand was last seen."""
    here = tracked()
    found = summed((here,), (gone(3),), (gone(3),), (here,), (gone(4.5),), (here,)).hands[1]
    assert (found.frames, found.losses, found.longest, found.is_lost) == (3, 2, 1.0, False)
    assert summed((here,), (gone(3),)).hands[1].is_lost


def test_each_hand_by_itself() -> None:
    """Hands are summarised by id, with their last side and size."""
    left, grown = tracked("left", id=2), replace(tracked(), bones=HEADER.skeleton.bones * 1.1)
    found = summed((tracked(hand="left"), left), (grown, left), (grown,)).hands
    assert (found[1].hand, found[1].frames, found[2].hand, found[2].frames) == ("right", 3, "left", 2)
    assert found[1].size == pytest.approx(1.1) and found[2].size == 1


def test_how_sure() -> None:
    """The confidence is the median of the known ones."""
    hands = [(tracked(confidence=value),) for value in (0.2, 0.9, 0.8, float("nan"))]
    assert summed(*hands).hands[1].sure == "80%"
    assert summed(hands[-1]).hands[1].sure == "unknown"
    assert summed((gone(1),)).hands[1].sure == "unknown"


def test_why_nothing_was_found() -> None:
    """The hands without a sure pose are counted by reason, without the figures in it."""
    found = Summary(HEADER.skeleton)
    assert found.nothing_found == "no hand was found: no place looked like one"
    for n, reasons in enumerate([("cold (12%)", "late"), ("cold (3%)",)]):
        hands = tuple(PresentHand(0, None, 0.5, 0.1, (0, 0, 700), reason) for reason in reasons)
        found.add(TrackedFrame(n, n / 2, (), (), hands))
    assert found.nothing_found == "no pose was found of the hands that were seen: cold (2); late (1)"


@pytest.mark.parametrize(("size", "confidence", "frames", "doubt"), [
    (0.8, 0.5, 40, ""), (0.95, 0.97, 40, ""), (0.95, 0.8, 14, ""),
    (0.95, 0.8, 40, "206 mm from the wrist to the tip of the middle finger, longer ... 20% or more too small"),
    (1.1, 0.97, 40, "239 mm ... longer ... too small"),
    (0.66, 0.97, 40, "143 mm ... shorter ... too large"),
])
def test_a_size_that_shows_wrong_focal_lengths(size: float, confidence: float, frames: int, doubt: str) -> None:
    hand = replace(tracked(confidence=confidence), bones=HEADER.skeleton.bones * size)
    found = summed(*[(hand,)] * frames).doubts
    assert len(found) == bool(doubt)
    assert all(re.fullmatch(f"hand 1: it has {doubt.replace('...', '.*')}", line) for line in found)
