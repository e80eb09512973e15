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

from dataclasses import replace
from typing import Generic, TypeVar

import numpy as np

from handpose.body.sides import Side, mirror_of
from handpose.fit.body import SIZE_INDEX, CapsuleModel, WorldPose
from handpose.fit.pose_confidence import least_error
from handpose.tracking.output import variables_of
from handpose.tracking.reporting import SureHands
from handpose.tracking.settings import TrackSettings
from handpose.tracking.smoothing import PoseFilter
from handpose.tracking.track import TrackedFrame, TrackedHand

# Limits of what is held: s and frames for a side, which is decided within 3 s; and frames that are
# known after one that is released.
MAX_UNDECIDED_S, MAX_UNDECIDED, LOOKAHEAD_FRAMES = 4.0, 150, 60

T = TypeVar("T")


class LaterFrames(Generic[T]):
    """Holds frames, each with an item that belongs to it, such as its image, until later
    ones are known.

    model           of the hands' surfaces, which are moved with the poses
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
            if hand.side_confidence >= self._settings.sides.likely:
                self._decide(hand.id, hand.hand)
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
                hands = tuple(_as(hand, side) if hand.id == id else hand for hand in frame.hands)
                self._held[n] = (item, frame._replace(hands=hands))

    def _settle(self) -> None:
        """Let the next frame wait no longer for a side."""
        _, frame = self._held[self._settled]
        self._judged += [(frame.time, hand) for hand in frame.hands]
        self._settled += 1

    def _release(self, count: int) -> list[tuple[T, TrackedFrame]]:
        """The first frames that are held, smoothed by all that are settled."""
        filters: dict[tuple[int, str], PoseFilter] = {}
        released = []
        sure, smooth = self._sure_ids(), self._settings.smooth
        for n in range(self._settled - 1, -1, -1):
            item, frame = self._held[n]
            poses = {
                (hand.id, hand.hand): hand.poses for hand in frame.hands if hand.poses is not None
            }
            filters = {key: filters.get(key) or PoseFilter(smooth) for key in poses}
            # The times of a filter ascend.
            backward = {
                key: filters[key](own.fitted, -frame.time, own.error_mm)
                for key, own in poses.items()
            }
            if n < count:
                hands = (
                    self._between(hand, backward.get((hand.id, hand.hand))) for hand in frame.hands
                )
                judged = tuple(self._judged_around(hand, frame.time) for hand in hands)
                present = tuple(
                    one._replace(is_sure=one.is_sure or one.id in sure) for one in frame.present
                )
                released.append((item, frame._replace(hands=judged, present=present)))
        del self._held[:count]
        self._settled -= count
        if self._settled:
            first = self._held[0][1].time - self._settings.later.lasting_s
            self._judged = [(time, hand) for time, hand in self._judged if time >= first]
        return released[::-1]

    def _sure_ids(self) -> set[int]:
        """The ids of the hands that have a pose or are sure in a frame that is held."""
        frames = [frame for _, frame in self._held]
        posed = {hand.id for frame in frames for hand in frame.hands}
        return posed | {one.id for frame in frames for one in frame.present if one.is_sure}

    def _sure(self, ready: list[tuple[T, TrackedFrame]]) -> list[tuple[T, TrackedFrame]]:
        return [(item, self.sure_hands(frame)) for item, frame in ready]

    def _between(self, hand: TrackedHand, backward: WorldPose | None) -> TrackedHand:
        """The hand at the mean of its smoothed pose and this one, with the same error
        and confidence.
        """
        if hand.poses is None or backward is None:
            return hand
        model, poses, mirror = self._model, hand.poses, mirror_of(hand.hand)
        body = poses.smoothed.moved(poses.smoothed.step_to(backward) / 2)
        center = hand.origin_mm * mirror
        x = variables_of(model, [body], center[None], poses.size)
        return replace(
            hand,
            inputs=model.inputs_of(x)[0],
            bones=model.skeleton.bones * float(np.exp(x[0, SIZE_INDEX])),
            xyz=(model.joints(x)[0] + center) * mirror,
            capsules=None
            if hand.capsules is None
            else model.capsules(x, center[None]).mirrored(mirror[None]),
            poses=poses._replace(smoothed=body),
        )

    def _judged_around(self, hand: TrackedHand, time: float) -> TrackedHand:
        """The hand with the mean of its errors around this time; unchanged if it was not smoothed
        or not judged.
        """
        if hand.poses is None or np.isnan(hand.error_mm):
            return hand
        lasting_s = self._settings.later.lasting_s
        around = [
            one
            for at, one in self._judged
            if abs(at - time) <= lasting_s and (one.id, one.hand) == (hand.id, hand.hand)
        ]
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
