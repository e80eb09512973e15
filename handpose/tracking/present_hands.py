"""Hands that a finder sees and that have no sure pose: where they are, and when a pose is tried there again."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from handpose.estimate.finder import FoundHand
from netlib.blob import Array

SAME_MM = 110.0  # a hand this close to one that is followed, or to one of the search before, is the same
PRESENT_S = 0.3  # s for which a hand is there that the finder saw
PAUSE, MAX_PAUSE = 0.25, 4.0  # s between tries of a pose at a place; doubled after each
FIRST_PAUSE = 0.1  # while no hand is tracked


@dataclass
class PresentPlace:
    """A hand as the finder saw it last, at ``time`` in s; a pose is tried from ``try_at`` on, then after ``pause``."""

    id: int
    hand: FoundHand
    time: float
    try_at: float
    pause: float = PAUSE

    def wait(self, time: float, at_once: bool) -> None:
        """Let some time pass until the next try; little if it is to be ``at_once``."""
        self.try_at = time + (FIRST_PAUSE if at_once else self.pause)
        self.pause = min(2 * self.pause, MAX_PAUSE)


class PresentHands:
    """The hands without a sure pose of the frames of a track, the most present first."""

    def __init__(self) -> None:
        self.places: list[PresentPlace] = []

    def see(self, hands: Sequence[FoundHand], taken: Sequence[Array], time: float, least: float, first: int) -> None:
        """Take the finder's hands of a frame, but those near places (3,) in mm that are ``taken``.

        least  presence of a hand that was not seen before
        first  number of the next new hand
        """
        before = [one for one in self.places if time < one.try_at + MAX_PAUSE and not _near(one.hand, taken)]
        self.places = []
        for hand in hands:
            if _near(hand, taken):
                continue
            same = [one for one in before if np.linalg.norm(one.hand.middle - hand.middle) < SAME_MM]
            if same:
                before.remove(same[0])
                same[0].hand, same[0].time = hand, time
                self.places.append(same[0])
            elif hand.presence >= least:
                self.places.append(PresentPlace(first, hand, time, time))
                first += 1
        self.places = sorted([*self.places, *before], key=lambda one: -one.hand.presence)

    def seen(self, time: float) -> list[PresentPlace]:
        """Those that were seen lately."""
        return [one for one in self.places if time - one.time < PRESENT_S]

    def due(self, time: float) -> list[PresentPlace]:
        """Those seen in this frame whose pose is to be tried."""
        return [one for one in self.places if one.time == time >= one.try_at]


def _near(hand: FoundHand, places: Sequence[Array]) -> bool:
    return any(np.linalg.norm(hand.middle - place) < SAME_MM for place in places)
