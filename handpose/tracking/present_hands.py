"""Hands that a finder sees and that have no sure pose: where they are, and when a pose is tried there again."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from handpose.estimate.finder import FoundHand
from netlib.blob import Array

SAME_MM = 110.0  # a hand this close to one that is followed, or to one of the search before, is the same
PRESENT_S = 0.3  # s for which a hand is there that the finder saw
PAUSE, MAX_PAUSE = 0.1, 1.6  # s between tries of a pose at a place; doubled after each


@dataclass
class PresentPlace:
    """A hand as the finder saw it last, at ``time`` in s; a pose is tried from ``try_at`` on."""

    id: int
    hand: FoundHand
    time: float
    try_at: float
    pause: float = PAUSE


class PresentHands:
    """The hands without a sure pose of the frames of a track, in their order."""

    def __init__(self) -> None:
        self.places: list[PresentPlace] = []

    def see(self, hands: Sequence[FoundHand], followed: Sequence[Array], time: float, least: float, first: int) -> None:
        """Take the finder's hands of a frame, but those near followed middles (3,) in mm.

        least  presence of a hand that was not seen before
        first  number of the next new hand
        """
        before, self.places = self.places, []
        for hand in hands:
            if _near(hand, followed):
                continue
            same = [one for one in before if np.linalg.norm(one.hand.middle - hand.middle) < SAME_MM]
            if same:
                before.remove(same[0])
                same[0].hand, same[0].time = hand, time
                self.places.append(same[0])
            elif hand.presence >= least:
                self.places.append(PresentPlace(first, hand, time, time))
                first += 1
        self.places += [one for one in before if time - one.time < PRESENT_S and not _near(one.hand, followed)]
        self.places.sort(key=lambda one: -one.hand.presence)


def _near(hand: FoundHand, middles: Sequence[Array]) -> bool:
    return any(np.linalg.norm(hand.middle - middle) < SAME_MM for middle in middles)
