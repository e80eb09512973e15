"""Hands that a finder sees and that have no sure pose: where they are, how evident they are, and
when a pose is tried there again.

A finder also takes cups, keyboards and monitors for hands, in every frame: a second look at a
surface that did not change adds no evidence. Where all of it differs from the look before by more
than the camera's noise, the evidence is doubled.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from handpose.body.sides import SideView
from handpose.estimate.finder import FoundHand
from handpose.tracking.settings import PresentSettings
from netlib.blob import Array

NOISE_MM = 0.5  # minimum noise of a camera: readings are whole mm


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

    presence  mean of the last looks
    changed   likewise, share of its surface that was another one than in the look before
    settings  tuned numbers
    is_sure   True if it is reported also while another hand has joints: once its evidence was high,
              or if a hand was followed there shortly before
    """

    id: int
    hand: FoundHand
    time: float
    try_at: float
    presence: float
    changed: float
    settings: PresentSettings
    pause: float
    is_sure: bool = False

    def look(self, presence: float, changed: float) -> None:
        """Add a look to the means."""
        weight = self.settings.look
        self.presence += weight * (presence - self.presence)
        self.changed += weight * (changed - self.changed)
        self.is_sure |= self.evidence >= self.settings.sure

    @property
    def evidence(self) -> float:
        """The presence if nothing changes, twice as much if all does."""
        return self.presence * (1 + self.changed)

    def wait(self, time: float, at_once: bool) -> None:
        """Let some time pass until the next try; little if it is to be ``at_once``."""
        self.try_at = time + (self.settings.soon_s if at_once else self.pause)
        self.pause = min(2 * self.pause, self.settings.max_pause_s)


class Changes:
    """Where a frame differs from the one of the look before.

    If the camera moves, nothing differs by more than the rest.
    """

    def __init__(self, frame: SideView, before: SideView, settings: PresentSettings) -> None:
        self._camera, self._settings = frame.camera, settings
        self._both = frame.readings, before.readings

    @cached_property
    def _range(self) -> tuple[Array, Array]:
        """The nearest and the farthest reading of each pixel."""
        return np.minimum(*self._both), np.maximum(*self._both)

    @cached_property
    def _noise(self) -> float:
        """The median change, divided by the square of the distance, with which noise grows."""
        nearest, farthest = self._range
        read = nearest > 0
        relative = (farthest - nearest)[read] / farthest[read] ** 2
        return float(np.median(relative)) if read.any() else 0.0

    def share_at(self, place: Array) -> float:
        """The share of the surface of a hand at a place (3,) in mm that differs."""
        s, size_mm = self._settings, self._settings.same_mm
        reach, z = np.array([size_mm / 2, -size_mm / 2, 0.0]), place[2]
        corners = self._camera.project([place - reach, place + reach])
        (left, top), (right, bottom) = corners[:, :2].astype(int).clip(0)
        window = np.s_[top : bottom + 1, left : right + 1]
        nearest, farthest = (values[window] for values in self._range)
        own = (nearest > max(z - size_mm, 0.0)) & (nearest < z + size_mm)
        noise = np.maximum(self._noise * farthest**2, NOISE_MM)
        return float((farthest - nearest > s.noises * noise)[own].mean()) if own.any() else 0.0


class PresentHands:
    """The hands without a sure pose of the frames of a track, the most present first.

    min_presence  of a new hand
    """

    def __init__(self, min_presence: float, settings: PresentSettings) -> None:
        self.min_presence, self.settings = min_presence, settings
        self.places: list[PresentPlace] = []
        self._ids = itertools.count()
        self._before: tuple[SideView, float] | None = None  # the look before, and its time in s

    def see(
        self, hands: Sequence[FoundHand], view: SideView, taken: Sequence[Taken], time: float
    ) -> None:
        """Take the finder's hands of a frame, but those that are ``taken``."""
        s, frame = self.settings, view.of("right")
        last, looked = self._before or (frame, time)
        changes = Changes(frame, last if time - looked <= s.compared_s else frame, s)
        self._before = frame, time
        before = [
            one
            for one in self.places
            if time < one.try_at + s.max_pause_s and not self._is_taken(one.hand, taken)
        ]
        self.places = []
        for hand in hands:
            place = next((one for one in before if self._is_same(hand, one.hand.middle)), None)
            is_weak = place is None and hand.presence < self.min_presence
            if is_weak or self._is_taken(hand, taken):
                continue
            presence, changed = hand.presence, changes.share_at(hand.middle)
            if place is None:
                id = next(self._ids)
                place = PresentPlace(id, hand, time, time, presence, changed, s, s.later_s)
            else:
                before.remove(place)
                place.hand, place.time = hand, time
            place.look(presence, changed)
            self.places.append(place)
        for place in before:
            place.look(0.0, 0.0)
        self.places = sorted([*self.places, *before], key=lambda one: -one.presence)

    @property
    def still_presence(self) -> float:
        """The presence that is enough for a hand that was there before."""
        return self.settings.still * self.min_presence

    @property
    def there(self) -> list[PresentPlace]:
        """Those that are present enough."""
        return [one for one in self.places if one.presence >= self.still_presence]

    @property
    def evident(self) -> list[PresentPlace]:
        """Those to report, the sure ones first, without those that are much less evident than
        another one.
        """
        there = sorted(self.there, key=lambda one: not one.is_sure)
        least = self.settings.still * max((one.evidence for one in there), default=0.0)
        return [one for one in there if one.is_sure or one.evidence >= least]

    def due(self, time: float) -> list[PresentPlace]:
        """Those seen in this frame whose pose is to be tried."""
        return [one for one in self.there if one.time == time >= one.try_at]

    def _is_taken(self, hand: FoundHand, taken: Sequence[Taken]) -> bool:
        return any(
            self._is_same(hand, place) and hand.presence <= hand_chance
            for place, hand_chance in taken
        )

    def _is_same(self, hand: FoundHand, place: Array) -> bool:
        """Whether a hand may be the one that was at a place (3,) in mm."""
        return bool(np.linalg.norm(hand.middle - place) < self.settings.same_mm)
