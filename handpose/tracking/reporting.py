"""The hands of tracked frames that are sure enough to be reported, and their ids."""

from __future__ import annotations

from dataclasses import dataclass, replace

from handpose.body.sides import Side
from handpose.tracking.reasons import uncertain
from handpose.tracking.settings import TrackSettings
from handpose.tracking.track import TrackedFrame, TrackedHand


@dataclass
class Given:
    """A hand whose joints were given.

    time    s, when it was there last
    side    None if it was never decided
    frames  number of frames with its joints
    """

    time: float
    side: Side | None
    frames: int = 0


class SureHands:
    """Reports the hands of the frames of a track, in their order, by their confidence; the tracker
    follows all on.

    A hand below the minimum confidence is present, without its joints; one whose confidence is
    unknown is not below. A hand is listed as lost only if its joints were given in
    ``min_given`` frames before. A finder sees hands in many things: beside a hand with joints, and
    for ``recent_s`` after one that can be lost, only those present hands are reported that are
    sure; where no hand has joints, all are. A minimum of 0 removes nothing.

    Ids of reported hands are numbers from 0, in the order in which hands are first reported; in one
    frame those with joints come first. A tracker's own ids also count places that it only looks at.

    frames  number of frames with a hand below the minimum
    ids     the reported id of each of the tracker's ids
    """

    def __init__(self, min_confidence: float, settings: TrackSettings) -> None:
        self.min_confidence, self.settings, self.frames = min_confidence, settings, 0
        self._given: dict[int, Given] = {}
        self.ids: dict[int, int] = {}
        self._posed = -float("inf")  # s, when a hand that can be lost had joints last

    @property
    def note(self) -> str:
        """How often a hand was taken out, as text; empty if never."""
        below = (
            f"{self.frames} frames have a hand with a confidence below {self.min_confidence:.0%}"
        )
        return f"{below}, whose joints are not given (--min-confidence)" if self.frames else ""

    def __call__(self, frame: TrackedFrame) -> TrackedFrame:
        """The frame with the hands that are sure enough, by their ids."""
        return self._numbered(self._sure(frame) if self.min_confidence else frame)

    def _sure(self, frame: TrackedFrame) -> TrackedFrame:
        hands = [self._if_sure(hand, frame.time) for hand in frame.hands]
        posed = [hand for hand in hands if hand.pose is not None]
        self.frames += len(posed) < len(hands)
        lost = [
            replace(one, since=self._given[one.id].time)
            for one in frame.lost
            if self._can_be_lost(one.id)
        ]
        is_beside = posed or frame.time - self._posed <= self.settings.follow.recent_s
        present = [one for one in frame.present if one.is_sure or not is_beside]
        return frame._replace(every=(*hands, *lost, *present))

    def _if_sure(self, hand: TrackedHand, time: float) -> TrackedHand:
        """A hand with a pose, without it below the minimum confidence."""
        before = self._given.get(hand.id)
        side = hand.known_side or (before.side if before else None)
        is_given = not hand.confidence < self.min_confidence
        if is_given or before:
            frames = before.frames if before else 0
            self._given[hand.id] = Given(time, side, frames + is_given)
        if not is_given:
            middle = hand.xyz.mean(axis=0)
            return hand.without_pose(side, middle, uncertain(hand.confidence))
        if self._can_be_lost(hand.id):
            self._posed = time
        return hand

    def _numbered(self, frame: TrackedFrame) -> TrackedFrame:
        """The frame with the ids that are reported, and without lost hands that never were."""
        for hand in (*frame.hands, *frame.present):
            self.ids.setdefault(hand.id, len(self.ids))
        every = [_with_id(hand, self.ids[hand.id]) for hand in frame.every if hand.id in self.ids]
        return frame._replace(every=tuple(sorted(every, key=lambda hand: hand.id)))

    def _can_be_lost(self, id: int) -> bool:
        least = self.settings.present.min_given
        return id in self._given and self._given[id].frames >= least


def _with_id(hand: TrackedHand, id: int) -> TrackedHand:
    """A hand with another id, also as one of the other side."""
    if hand.id == id:
        return hand
    other = None if hand.other is None else replace(hand.other, id=id)
    return replace(hand, id=id, other=other)
