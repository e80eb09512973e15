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
from handpose.tracking.settings import PresentSettings
from netlib.blob import Array


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
    settings      tuned numbers
    highest       its maximum so far
    was_followed  True if a hand was followed there shortly before
    """

    id: int
    hand: FoundHand
    time: float
    try_at: float
    presence: float
    settings: PresentSettings
    pause: float
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
        return self.highest >= self.settings.sure or self.was_followed

    def wait(self, time: float, at_once: bool) -> None:
        """Let some time pass until the next try; little if it is to be ``at_once``."""
        self.try_at = time + (self.settings.soon_s if at_once else self.pause)
        self.pause = min(2 * self.pause, self.settings.max_pause_s)


class PresentHands:
    """The hands without a sure pose of the frames of a track, the most present first.

    min_presence  of a new hand
    """

    def __init__(self, min_presence: float, settings: PresentSettings) -> None:
        self.min_presence, self.settings = min_presence, settings
        self.places: list[PresentPlace] = []
        self._ids = itertools.count()

    def see(self, hands: Sequence[FoundHand], taken: Sequence[Taken], time: float) -> None:
        """Take the finder's hands of a frame, but those that are ``taken``."""
        s = self.settings
        before = [
            one
            for one in self.places
            if time < one.try_at + s.max_pause_s and not self._is_taken(one.hand, taken)
        ]
        self.places = []
        for hand in hands:
            if self._is_taken(hand, taken):
                continue
            place = next(
                (
                    one
                    for one in before
                    if np.linalg.norm(one.hand.middle - hand.middle) < s.same_mm
                ),
                None,
            )
            if place is not None:
                before.remove(place)
                place.hand, place.time = hand, time
                place.presence += s.look * (hand.presence - place.presence)
                self.places.append(place)
            elif hand.presence >= self.min_presence:
                id, presence = next(self._ids), hand.presence
                self.places.append(PresentPlace(id, hand, time, time, presence, s, s.later_s))
        for place in before:
            place.presence *= 1 - s.look
        self.places = sorted([*self.places, *before], key=lambda one: -one.presence)
        for place in self.places:
            place.highest = max(place.highest, place.presence)

    @property
    def still_presence(self) -> float:
        """The presence that is enough for a hand that was there before."""
        return self.settings.still * self.min_presence

    @property
    def there(self) -> list[PresentPlace]:
        """Those that are present enough."""
        return [one for one in self.places if one.presence >= self.still_presence]

    def due(self, time: float) -> list[PresentPlace]:
        """Those seen in this frame whose pose is to be tried."""
        return [one for one in self.there if one.time == time >= one.try_at]

    def _is_taken(self, hand: FoundHand, taken: Sequence[Taken]) -> bool:
        return any(
            np.linalg.norm(hand.middle - place) < self.settings.same_mm
            and hand.presence <= hand_chance
            for place, hand_chance in taken
        )
