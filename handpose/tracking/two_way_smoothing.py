"""Smoothing of recordings in both directions of time, without lag.

The filter of ``smoothing`` follows a moving hand with a delay, because it only knows earlier frames. In a recording the
later frames are known, too: run from the future to the past, the same filter is ahead by about the same delay. The mean
of both has none, and less jitter than either.

A run of frames ends where a hand is missing or changes its side: the filters of the track start again there.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Generic, TypeVar

import numpy as np

from handpose.body.sides import mirror_of
from handpose.fit.body import SIZE, CapsuleModel, WorldPose
from handpose.tracking.output import variables_of
from handpose.tracking.smoothing import PoseFilter, turn_between, turned
from handpose.tracking.track import TrackedFrame, TrackedHand

# Frames are released once this time, in s, or number of frames after them is known. Twice as much is held, so that
# frames are filtered backwards twice at most. On two synthetic recordings (the scripts `gestures` and `left`, seeds 5
# and 6), one second gives the jitter at rest of the whole recording, 0.33 and 0.16 mm; half a second 0.35 and 0.18 mm.
AHEAD_S, AHEAD = 1.0, 60

T = TypeVar("T")


class TwoWaySmoothing(Generic[T]):
    """Holds frames, each with an item that belongs to it, such as its image, until later ones are known.

    model  of the hands' surfaces, which are moved with the poses
    """

    def __init__(self, model: CapsuleModel) -> None:
        self._model = model
        self._held: list[tuple[T, TrackedFrame]] = []

    def add(self, ready: Sequence[tuple[T, TrackedFrame]]) -> list[tuple[T, TrackedFrame]]:
        """Add the next frames. Returns those that need not be held any longer, in order, smoothed in both directions.

        Hands whose poses were not smoothed are not changed.
        """
        self._held += ready
        if not self._held:
            return []
        newest = self._held[-1][1].time
        if newest - self._held[0][1].time < 2 * AHEAD_S and len(self._held) < 2 * AHEAD:
            return []
        early = sum(newest - frame.time >= AHEAD_S for _, frame in self._held)
        return self._release(max(early, len(self._held) - AHEAD))

    def finish(self) -> list[tuple[T, TrackedFrame]]:
        """The frames that are still held, at the end of the recording."""
        return self._release(len(self._held))

    def _release(self, count: int) -> list[tuple[T, TrackedFrame]]:
        """The first frames that are held, which are smoothed."""
        filters: dict[tuple[int, str], PoseFilter] = {}
        released = []
        for n in range(len(self._held) - 1, -1, -1):
            item, frame = self._held[n]
            poses = {(hand.id, hand.hand): hand.poses for hand in frame.hands if hand.poses is not None}
            filters = {key: filters.get(key) or PoseFilter() for key in poses}
            # The times of a filter ascend.
            backward = {key: filters[key](own.fitted, -frame.time, own.error_mm) for key, own in poses.items()}
            if n < count:
                hands = tuple(self._between(hand, backward.get((hand.id, hand.hand))) for hand in frame.hands)
                released.append((item, frame._replace(hands=hands)))
        del self._held[:count]
        return released[::-1]

    def _between(self, hand: TrackedHand, backward: WorldPose | None) -> TrackedHand:
        """The hand at the mean of its smoothed pose and this one. Error and confidence remain."""
        if hand.poses is None or backward is None:
            return hand
        model, poses, mirror = self._model, hand.poses, mirror_of(hand.hand)
        body, center = middle_of(poses.smoothed, backward), hand.origin_mm * mirror
        x = variables_of(model, [body], center[None], poses.size)
        return replace(
            hand,
            inputs=model.inputs_of(x)[0],
            bones=model.skeleton.bones * float(np.exp(x[0, SIZE])),
            xyz=(model.joints(x)[0] + center) * mirror,
            capsules=None if hand.capsules is None else model.capsules(x, center[None]).mirrored(mirror[None]),
            poses=poses._replace(smoothed=body),
        )


def middle_of(first: WorldPose, second: WorldPose) -> WorldPose:
    """The pose half-way between two."""
    return WorldPose(
        (first.place + second.place) / 2,
        turned(first.rotation, turn_between(first.rotation, second.rotation) / 2),
        (first.others + second.others) / 2,
    )
