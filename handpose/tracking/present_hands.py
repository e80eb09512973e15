"""Hands that a finder sees and that have no sure pose: where they are, and when a pose is
tried there again.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from handpose.estimate.finder import FoundHand
from netlib.blob import Array

# a hand this close to one that is followed, or to one of the search before, is the same
SAME_MM = 110.0
STILL = 0.5  # part of the minimum presence that is enough for a hand that was there before
LOOK = 0.5  # weight of the last look in the mean presence
# Seconds between two runs of a slow step: a search for another hand, a pose at a place, a full fit
# of an uncertain hand, a prediction that competes with the tracked pose; the same while there is no
# hand, no pose or no decided side.
LATER_S, SOON_S = 0.2, 0.1
MAX_PAUSE = 4.0  # s: pauses at one place are doubled after each try
# A mean presence from which a place is a hand also beside a hand with joints. On two recordings of
# one hand (CVAR's P4 and P6), places without a hand, such as a keyboard, a head and a monitor,
# reach 0.67. A second hand laid into these recordings has 0.71 to 0.85 where its pose is not found,
# but down to 0.37 at a distance of 0.7 m.
SURE_PRESENCE = 0.75


class Taken(NamedTuple):
    """A place (3,) in mm where only a hand with a higher presence than ``hand_chance``
    is another one.
    """

    place: Array
    hand_chance: float


@dataclass
class PresentPlace:
    """A hand as the finder saw it last, at ``time`` in s; a pose is tried from ``try_at`` on, then
    after ``pause``.

    presence      mean of the last looks
    highest       its maximum so far
    was_followed  True if a hand was followed there shortly before
    """

    id: int
    hand: FoundHand
    time: float
    try_at: float
    presence: float
    pause: float = LATER_S
    highest: float = 0.0
    was_followed: bool = False

    @property
    def is_sure(self) -> bool:
        """True if it is reported also while another hand has joints.

        Motion is no evidence: in one second, a tenth of the places without a hand move by more than
        57 mm on P4 and 60 on P6, with what the finder sees of them, and a tenth of those on a
        moving second hand by more than 59 to 71 mm. Nor is a pose that is too doubtful to be
        followed: in a further recording (hpx), an upper arm has such ones.
        """
        return self.highest >= SURE_PRESENCE or self.was_followed

    def wait(self, time: float, at_once: bool) -> None:
        """Let some time pass until the next try; little if it is to be ``at_once``."""
        self.try_at = time + (SOON_S if at_once else self.pause)
        self.pause = min(2 * self.pause, MAX_PAUSE)


class PresentHands:
    """The hands without a sure pose of the frames of a track, the most present first.

    min_presence  of a new hand
    """

    def __init__(self, min_presence: float) -> None:
        self.min_presence = min_presence
        self.places: list[PresentPlace] = []
        self._ids = itertools.count()

    def see(self, hands: Sequence[FoundHand], taken: Sequence[Taken], time: float) -> None:
        """Take the finder's hands of a frame, but those that are ``taken``."""
        before = [
            one
            for one in self.places
            if time < one.try_at + MAX_PAUSE and not _is_taken(one.hand, taken)
        ]
        self.places = []
        for hand in hands:
            if _is_taken(hand, taken):
                continue
            place = next(
                (one for one in before if np.linalg.norm(one.hand.middle - hand.middle) < SAME_MM),
                None,
            )
            if place is not None:
                before.remove(place)
                place.hand, place.time = hand, time
                place.presence += LOOK * (hand.presence - place.presence)
                self.places.append(place)
            elif hand.presence >= self.min_presence:
                self.places.append(PresentPlace(next(self._ids), hand, time, time, hand.presence))
        for place in before:
            place.presence *= 1 - LOOK
        self.places = sorted([*self.places, *before], key=lambda one: -one.presence)
        for place in self.places:
            place.highest = max(place.highest, place.presence)

    @property
    def there(self) -> list[PresentPlace]:
        """Those that are present enough."""
        return [one for one in self.places if one.presence >= STILL * self.min_presence]

    def due(self, time: float) -> list[PresentPlace]:
        """Those seen in this frame whose pose is to be tried."""
        return [one for one in self.there if one.time == time >= one.try_at]


def _is_taken(hand: FoundHand, taken: Sequence[Taken]) -> bool:
    return any(
        np.linalg.norm(hand.middle - place) < SAME_MM and hand.presence <= hand_chance
        for place, hand_chance in taken
    )
