"""Frames of a recording held back until the sides of their hands are decided.

A live track has to report a hand before its side is decided. In a recording the decision may be used for the frames
before it: both sides were tracked in them, and the pose of the decided one replaces the assumed one.
"""

from __future__ import annotations

from collections import deque
from dataclasses import replace
from typing import Generic, TypeVar

from handpose.body.sides import Side
from handpose.tracking.track import TrackedFrame, TrackedHand

MAX_HELD_S, MAX_HELD = 4.0, 150  # s and number of frames that are held; a side is decided within 3 s
LIKELY_SIDE = 0.69  # probability of a side that is reported at the end of a recording, before it was decided

T = TypeVar("T")


class Lookahead(Generic[T]):
    """Holds frames, each with an item that belongs to it, such as its image."""

    def __init__(self) -> None:
        self._held: deque[tuple[T, TrackedFrame]] = deque()

    def add(self, item: T, frame: TrackedFrame) -> list[tuple[T, TrackedFrame]]:
        """Add the next frame. Returns the frames that need not be held any longer, in order."""
        self._held.append((item, frame))
        for hand in frame.hands:
            if hand.known_side is not None:
                self._settle(hand.id, hand.known_side)
        ready = []
        while self._held and not self._waits(self._held[0][1], frame):
            ready.append(self._held.popleft())
        return ready

    def finish(self) -> list[tuple[T, TrackedFrame]]:
        """The frames that are still held, at the end of the recording."""
        last = {hand.id: hand for _, frame in self._held for hand in frame.hands}
        for hand in last.values():
            if hand.side_confidence >= LIKELY_SIDE:
                self._settle(hand.id, hand.hand)
        ready = list(self._held)
        self._held.clear()
        return ready

    def _waits(self, frame: TrackedFrame, newest: TrackedFrame) -> bool:
        """True while a side in a frame may still be decided."""
        if newest.time - frame.time > MAX_HELD_S or len(self._held) > MAX_HELD:
            return False
        return any(hand.known_side is None for hand in frame.hands)

    def _settle(self, id: int, side: Side) -> None:
        """Use a decided side in all frames that are held."""
        for n, (item, frame) in enumerate(self._held):
            if any(hand.id == id and hand.known_side is None for hand in frame.hands):
                hands = tuple(_as(hand, side) if hand.id == id else hand for hand in frame.hands)
                self._held[n] = (item, frame._replace(hands=hands))


def _as(hand: TrackedHand, side: Side) -> TrackedHand:
    """A hand of an undecided side as one of this side."""
    own = hand if hand.hand == side else hand.other
    if hand.known_side is not None or own is None:
        return hand
    return replace(own, confidence=own.confidence / own.side_confidence, side_confidence=1.0, other=None)
