"""Match the tracked hands to the true hands, frame by frame.

In each frame the matching minimises the distances of the joints (as in CLEAR MOT, Bernardin and Stiefelhagen 2008),
up to a bound: a tracked hand beyond it is a false positive.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from handpose.body.sides import Side
from handpose.tracking.track import PARTLY, LostHand, TrackedFrame, TrackedHand
from netlib.errors import DataError

BOUND_MM = 100.0  # maximum mean error of the joints of a matched hand; a hand is twice as long


class Seen(NamedTuple):
    """A true hand in a frame in which it is visible; ``tracked`` is None if it was not found."""

    number: int
    time: float
    true: TrackedHand
    tracked: TrackedHand | None
    said_lost: bool  # True if it was not found and the track lists it as lost


class Gone(NamedTuple):
    """A true hand in a frame in which it is not visible; ``tracked`` is None if the track does not list it as lost."""

    number: int
    true: LostHand
    tracked: LostHand | None


@dataclass
class Followed:
    """The frames of one true hand, matched."""

    id: int
    hand: Side
    seen: list[Seen] = field(default_factory=list)
    gone: list[Gone] = field(default_factory=list)


class Matched(NamedTuple):
    """The true hands by id, and the number of false positives in each frame with any: {number: count}."""

    hands: dict[int, Followed]
    invented: dict[int, int]


def match(tracked: Iterable[TrackedFrame], true: Iterable[TrackedFrame], bound_mm: float = BOUND_MM) -> Matched:
    """Match all frames of the truth. A frame missing from the track has no hands.

    Where a true hand is partly visible, tracked hands near it do not count. Raises DataError for frames of the track
    that the truth does not have, and for two frames of the same number.
    """
    tracked_frames, true_frames = _by_number(tracked, "track"), _by_number(true, "truth")
    foreign = sorted(set(tracked_frames) - set(true_frames))
    if foreign:
        raise DataError(f"frame {foreign[0]} of the track is not in the truth; expected a track of the same recording")
    hands: dict[int, Followed] = {}
    invented = {}
    last: dict[int, int] = {}  # the tracked id of each true hand
    for number, frame in sorted(true_frames.items()):
        other = tracked_frames.get(number, TrackedFrame(number, frame.time, ()))
        pairs = _pairs(frame.hands, other.hands, bound_mm)
        lost = {one.id: one for one in other.lost}
        for n, hand in enumerate(frame.hands):
            found = other.hands[pairs[n]] if n in pairs else None
            said = found is None and last.get(hand.id) in lost
            own = hands.setdefault(hand.id, Followed(hand.id, hand.hand))
            own.seen.append(Seen(number, frame.time, hand, found, said))
            if found is not None:
                last[hand.id] = found.id
        partly = 0
        for gone in frame.lost:
            if gone.reason.startswith(PARTLY):
                partly += 1
            elif gone.hand is not None:
                own = hands.setdefault(gone.id, Followed(gone.id, gone.hand))
                own.gone.append(Gone(number, gone, lost.get(last.get(gone.id, -1))))
        extra = max(len(other.hands) - len(pairs) - partly, 0)
        if extra:
            invented[number] = extra
    return Matched(dict(sorted(hands.items())), invented)


def _pairs(true: tuple[TrackedHand, ...], tracked: tuple[TrackedHand, ...], bound_mm: float) -> dict[int, int]:
    """The tracked hands matched to true ones, by index."""
    from scipy.optimize import linear_sum_assignment  # imported here: it takes a third of a second

    if not true or not tracked:
        return {}
    for hand in tracked:
        if hand.xyz.shape != true[0].xyz.shape:
            raise DataError(f"a track of joints {hand.xyz.shape}, its truth has {true[0].xyz.shape}; "
                            "expected one skeleton")
    apart = np.array([[np.linalg.norm(a.xyz - b.xyz, axis=1).mean() for b in tracked] for a in true])
    rows, columns = linear_sum_assignment(np.minimum(apart, 10 * bound_mm))
    return {int(n): int(m) for n, m in zip(rows, columns) if apart[n, m] <= bound_mm}


def _by_number(frames: Iterable[TrackedFrame], what: str) -> dict[int, TrackedFrame]:
    found: dict[int, TrackedFrame] = {}
    for frame in frames:
        if frame.number in found:
            raise DataError(f"the {what} has two frames {frame.number}; expected one")
        found[frame.number] = frame
    return found
