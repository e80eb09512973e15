"""What later frames of a recording show: the sides of hands, their poses without lag, and
errors that last.

Frames are held until this is known.

Sides. A live track has to report a hand before its side is decided. In a recording both sides were
tracked in the frames before the decision, and the pose of the decided one replaces the assumed one.

Poses. The filter of ``smoothing`` follows a moving hand with a delay, because it only knows earlier
frames. Run from the future to the past, the same filter is ahead by about the same delay. The mean
of both has none, and less jitter than either. A run of frames ends where a hand is missing or
changes its side: the filters of the track start again there.

Presence. A hand that is doubtful at first is the same as one that is sure, or has a pose,
a moment later.

Errors last, since a track follows a wrong finger for a while, but the image of a single frame may
not show it. So the expected errors of hands become means over the time around each frame, and no
confidence is above that mean. Those of fingers remain: a finger that is hidden for a moment is a
guess for that moment.
"""

from __future__ import annotations

from collections.abc import Container, Mapping
from dataclasses import replace
from typing import Generic, TypeVar

import numpy as np

from handpose.body.sides import Side, mirror_of
from handpose.fit.body import CapsuleModel, WorldPose
from handpose.fit.pose_confidence import least_error
from handpose.tracking.output import posed, variables_of
from handpose.tracking.reporting import SureHands
from handpose.tracking.settings import TrackSettings
from handpose.tracking.smoothing import PoseFilter
from handpose.tracking.track import HandPose, TrackedFrame, TrackedHand, TrackedPoses

# Limits of what is held: s and frames for a side, which is decided within 3 s; and frames that are
# known after one that is released.
MAX_UNDECIDED_S, MAX_UNDECIDED, LOOKAHEAD_FRAMES = 4.0, 150, 60

T = TypeVar("T")


class LaterFrames(Generic[T]):
    """Holds frames, each with an item that belongs to it, such as its image, until later
    ones are known.

    model           of the hands
    min_confidence  as for ``SureHands``, which come last, because decided sides and smoothing
                    change the confidence
    at_once         release frames without waiting for later ones
    settings        of the tracker
    """

    def __init__(
        self,
        model: CapsuleModel,
        min_confidence: float = 0.0,
        at_once: bool = False,
        settings: TrackSettings = TrackSettings(),
    ) -> None:
        self._model, self._at_once, self._settings = model, at_once, settings
        self.sure_hands = SureHands(min_confidence, self._settings)
        self._held: list[tuple[T, TrackedFrame]] = []
        self._settled = 0  # number of frames held, from the first on, that do not wait for a side
        # hands of these frames and of those shortly before
        self._judged: list[tuple[float, TrackedHand]] = []

    def add(self, item: T, frame: TrackedFrame) -> list[tuple[T, TrackedFrame]]:
        """Add the next frame.

        Returns those that need not be held any longer, in order, smoothed in both directions.

        Hands whose poses were not smoothed are not changed, but for their side.
        """
        if self._at_once:
            return self._sure([(item, frame)])
        self._held.append((item, frame))
        for hand in frame.hands:
            if hand.known_side is not None:
                self._decide(hand.id, hand.known_side)
        while self._settled < len(self._held) and not self._waits(
            self._held[self._settled][1], frame
        ):
            self._settle()
        if not self._settled:
            return []
        newest = self._held[self._settled - 1][1].time
        lookahead_s = self._settings.later.lookahead_s
        if (
            newest - self._held[0][1].time < 2 * lookahead_s
            and self._settled < 2 * LOOKAHEAD_FRAMES
        ):
            return []
        early = sum(newest - frame.time >= lookahead_s for _, frame in self._held[: self._settled])
        return self._sure(self._release(max(early, self._settled - LOOKAHEAD_FRAMES)))

    def finish(self) -> list[tuple[T, TrackedFrame]]:
        """The frames that are still held, at the end of the recording."""
        last = {hand.id: hand for _, frame in self._held[self._settled :] for hand in frame.hands}
        for hand in last.values():
            if hand.side_confidence >= self._settings.sides.min_probability:
                self._decide(hand.id, hand.the_pose.side)
        while self._settled < len(self._held):
            self._settle()
        return self._sure(self._release(self._settled))

    def _waits(self, frame: TrackedFrame, newest: TrackedFrame) -> bool:
        """True while a side in a frame may still be decided."""
        if (
            newest.time - frame.time > MAX_UNDECIDED_S
            or len(self._held) - self._settled > MAX_UNDECIDED
        ):
            return False
        return any(hand.known_side is None for hand in frame.hands)

    def _decide(self, id: int, side: Side) -> None:
        """Use a decided side in all frames that wait for it."""
        for n in range(self._settled, len(self._held)):
            item, frame = self._held[n]
            if any(hand.id == id and hand.known_side is None for hand in frame.hands):
                every = tuple(_as(hand, side) if hand.id == id else hand for hand in frame.every)
                self._held[n] = (item, frame._replace(every=every))

    def _settle(self) -> None:
        """Let the next frame wait no longer for a side."""
        _, frame = self._held[self._settled]
        self._judged += [(frame.time, hand) for hand in frame.hands]
        self._settled += 1

    def _release(self, count: int) -> list[tuple[T, TrackedFrame]]:
        """The first frames that are held, smoothed by all that are settled."""
        filters: dict[tuple[int, Side | None], PoseFilter] = {}
        released = []
        sure = self._sure_ids()
        smooth = self._settings.smooth
        for n in range(self._settled - 1, -1, -1):
            item, frame = self._held[n]
            poses = {
                (hand.id, hand.hand): hand.pose.followed
                for hand in frame.every
                if hand.pose is not None and hand.pose.followed is not None
            }
            filters = {key: filters.get(key) or PoseFilter(smooth) for key in poses}
            # The times of a filter ascend.
            backward = {
                key: filters[key](own.fitted, -frame.time, own.error_mm)
                for key, own in poses.items()
            }
            if n < count:
                every = tuple(self._later(hand, frame.time, backward, sure) for hand in frame.every)
                released.append((item, frame._replace(every=every)))
        del self._held[:count]
        self._settled -= count
        if self._settled:
            first = self._held[0][1].time - self._settings.later.lasting_s
            self._judged = [(time, hand) for time, hand in self._judged if time >= first]
        return released[::-1]

    def _sure_ids(self) -> set[int]:
        """The ids of the hands that have a pose or are sure in a frame that is held."""
        return {
            hand.id
            for _, frame in self._held
            for hand in frame.every
            if hand.is_sure and not hand.is_lost
        }

    def _sure(self, ready: list[tuple[T, TrackedFrame]]) -> list[tuple[T, TrackedFrame]]:
        return [(item, self.sure_hands(frame)) for item, frame in ready]

    def _later(
        self,
        hand: TrackedHand,
        time: float,
        backward: Mapping[tuple[int, Side | None], WorldPose],
        sure: Container[int],
    ) -> TrackedHand:
        """A hand of a frame at this time, as later frames show it.

        backward  the smoothed poses of the frame from the future to the past, by ids and sides
        sure      the ids of sure hands
        """
        if hand.pose is None:
            return replace(hand, is_sure=hand.is_sure or hand.id in sure)
        if hand.pose.followed is None:
            return hand
        pose = self._between(hand.pose, hand.pose.followed, backward[hand.id, hand.hand])
        return self._judged_around(replace(hand, pose=pose), time)

    def _between(self, pose: HandPose, poses: TrackedPoses, backward: WorldPose) -> HandPose:
        """The mean of a smoothed pose and one that was smoothed backwards."""
        body = poses.smoothed.moved(poses.smoothed.step_to(backward) / 2)
        center = pose.origin_mm * mirror_of(pose.side)
        x = variables_of(self._model, [body], center[None], poses.size)
        moved = posed(pose, self._model, x)
        return replace(moved, followed=poses._replace(smoothed=body))

    def _judged_around(self, hand: TrackedHand, time: float) -> TrackedHand:
        """The hand with the mean of its errors around this time; unchanged if it was not judged."""
        if np.isnan(hand.error_mm):
            return hand
        lasting_s = self._settings.later.lasting_s
        near = [one for at, one in self._judged if abs(at - time) <= lasting_s]
        around = [one for one in near if (one.id, one.hand) == (hand.id, hand.hand)]
        confidence = min(hand.confidence, float(np.mean([one.confidence for one in around])))
        error_mm = np.maximum(
            np.mean([one.error_mm for one in around]), least_error(np.array(confidence))
        )
        return replace(hand, confidence=confidence, error_mm=float(error_mm))


def _as(hand: TrackedHand, side: Side) -> TrackedHand:
    """A hand of an undecided side as one of this side."""
    own = hand if hand.hand == side else hand.other
    if hand.known_side is not None or own is None:
        return hand
    return replace(
        own, confidence=own.confidence / own.side_confidence, side_confidence=1.0, other=None
    )
