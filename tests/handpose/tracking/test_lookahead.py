"""handpose/tracking/lookahead.py"""

from __future__ import annotations

from dataclasses import replace

from handpose.tracking.lookahead import MAX_HELD_S, Lookahead
from handpose.tracking.track import TrackedFrame, TrackedHand
from tests.support.tracked_hands import tracked


def undecided(right: float) -> TrackedHand:
    """A hand that is a right one with this probability, and its other side."""
    sides = {
        side: replace(tracked(side), confidence=0.8 * likely, side_confidence=likely)
        for side, likely in (("right", right), ("left", 1 - right))
    }
    likely, other = ("right", "left") if right >= 0.5 else ("left", "right")
    return replace(sides[likely], other=sides[other])


def frames(*hands: TrackedHand | None, step: float = 0.1) -> list[TrackedFrame]:
    """Frames with one hand or none."""
    return [TrackedFrame(n, n * step, (hand,) if hand else ()) for n, hand in enumerate(hands)]


def test_a_later_decision_is_used() -> None:
    """Frames wait for the decision; those in which the other side was assumed get the pose of the decided one."""
    held = Lookahead[str]()
    first, second, third = frames(undecided(0.8), undecided(0.4), tracked("left"))
    assert held.add("a", first) == held.add("b", second) == []
    ready = held.add("c", third)
    assert [item for item, _ in ready] == ["a", "b", "c"] and held.finish() == []
    for _, frame in ready:
        (hand,) = frame.hands
        assert hand.known_side == "left" and hand.other is None
        assert hand.confidence == tracked("left").confidence or abs(hand.confidence - 0.8) < 1e-9


def test_decided_hands_are_not_held() -> None:
    """A frame without an undecided side is released at once, after those before it."""
    held = Lookahead[int]()
    for frame in frames(None, tracked("right")):
        assert [found for _, found in held.add(0, frame)] == [frame]


def test_the_end_of_a_recording() -> None:
    """At the end, a likely side is used for the frames that are still held; an unlikely one remains unknown."""
    for right, side in ((0.95, "right"), (0.55, None)):
        held = Lookahead[int]()
        for frame in frames(undecided(0.6), undecided(right)):
            assert not held.add(0, frame)
        assert [hand.known_side for _, frame in held.finish() for hand in frame.hands] == [side, side]


def test_frames_are_not_held_for_long() -> None:
    """After some seconds a frame is released with its side unknown."""
    held = Lookahead[int]()
    step = MAX_HELD_S / 2
    ready = [found for frame in frames(*[undecided(0.5)] * 5, step=step) for _, found in held.add(0, frame)]
    assert [frame.number for frame in ready] == [0, 1]
    assert all(hand.known_side is None and hand.side_name == "unknown" for frame in ready for hand in frame.hands)
