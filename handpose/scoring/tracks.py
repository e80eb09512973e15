"""Scores of a track against the truth: errors, lost and false hands, identities, sides, jitter, lag, bones.

scores = score(tracker.header, tracker.follow(recording), recording.truths())  # of a SyntheticRecording
scores.hands[0].lag_ms
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from handpose.body.nyu import ANNOTATION_OF_JOINT, EVALUATION_JOINTS
from handpose.body.sides import Side
from handpose.tracking.track import PARTLY, LostHand, TrackedFrame, TrackedHand, TrackHeader
from netlib.blob import Array
from netlib.errors import DataError

REST_MM = 0.05  # maximum step of any joint of a hand at rest from frame to frame
SETTLE_S = 0.4  # start of every rest that is not scored, because the track may still settle
WINDOW_S = 0.5  # window; slower errors are drift, not jitter
MOVING_MM_S = 100.0  # minimum mean speed of the joints of a moving hand
LAGS_S = np.arange(-0.1, 0.3001, 0.005)  # lags tried; the best is refined by a parabola
NAN = float("nan")


def jitter(numbers: Array, times: Array, tracked: Array, true: Array) -> float:
    """The jitter in mm of tracked joints while the true ones are at rest; NaN without rest.

    It is the root mean square of the distances from their mean over windows of about ``WINDOW_S``: the standard
    deviation of all three coordinates together. The mean is removed window by window, which is a high-pass filter: a
    wrong length of a bone is an error, but no jitter. Frames (N,) have numbers; a missing frame ends a rest.
    """
    squares, freedom = 0.0, 0
    for window in _windows(numbers, times, true):
        off = tracked[window] - true[window]
        squares += float(((off - off.mean(axis=0)) ** 2).sum())
        freedom += (len(window) - 1) * off.shape[1]
    return float(np.sqrt(squares / freedom)) if freedom else NAN


def _windows(numbers: Array, times: Array, true: Array) -> list[NDArray[np.int_]]:
    """The frames of rests, except for their first ``SETTLE_S``, in equal parts of about ``WINDOW_S``."""
    windows = []
    for first, last in rests(numbers, true):
        begin = first + int(np.searchsorted(times[first:last], times[first] + SETTLE_S - 1e-9))
        parts = round((times[last - 1] - times[begin]) / WINDOW_S) if begin < last else 0
        if parts:
            windows += np.array_split(np.arange(begin, last), parts)
    return [window for window in windows if len(window) > 1]


def rests(numbers: Array, true: Array) -> list[tuple[int, int]]:
    """Runs of frames, from and to (exclusive), in which the hand does not move."""
    still = np.linalg.norm(np.diff(true, axis=0), axis=2).max(axis=1) <= REST_MM if len(true) > 1 else np.zeros(0, bool)
    return [(first, last + 1) for first, last in _runs(still & (np.diff(numbers) == 1))]


def lag_s(numbers: Array, times: Array, tracked: Array, true: Array) -> float:
    """The delay in s of the tracked joints that minimises the squared difference to the true ones.

    Over frames in which the hand moves; the true joints between frames are a cubic spline. A constant error in a run of
    frames does not count as lag: it is removed. NaN without movement, or without a minimum within ``LAGS_S``.
    """
    from scipy.interpolate import CubicSpline  # imported here: it takes a third of a second

    squares = np.zeros(len(LAGS_S))
    for first, last in [(a, b + 1) for a, b in _runs(np.diff(numbers) == 1)]:
        t, truth = times[first:last], true[first:last]
        if last - first < 4:
            continue
        spline = CubicSpline(t, truth)
        fast = np.linalg.norm(spline(t, 1), axis=2).mean(axis=1) >= MOVING_MM_S
        used = fast & (t - LAGS_S[-1] >= t[0] - 1e-9) & (t - LAGS_S[0] <= t[-1] + 1e-9)
        if not used.any():
            continue
        for n, lag in enumerate(LAGS_S):
            off = tracked[first:last][used] - spline(t[used] - lag)
            squares[n] += float(((off - off.mean(axis=0)) ** 2).sum())
    best = int(squares.argmin())
    if not squares.any() or best in (0, len(LAGS_S) - 1):
        return NAN
    before, least, after = squares[best - 1 : best + 2]
    return float(LAGS_S[best] + (LAGS_S[1] - LAGS_S[0]) * (before - after) / (2 * (before - 2 * least + after)))


def bone_changes(tracked: Array, parents: Array) -> Array:
    """The largest deviation (K,) of each bone's length from its median over time, mm; 0 for a root."""
    lengths = np.linalg.norm(tracked - tracked[:, parents], axis=2)
    return np.asarray(np.where(parents >= 0, np.abs(lengths - np.median(lengths, axis=0)).max(axis=0), 0.0))


def _runs(good: Array) -> list[tuple[int, int]]:
    """Runs of truth, from and to (exclusive)."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], good, [False]]).astype(int)))
    return [(int(a), int(b)) for a, b in edges.reshape(-1, 2)]


BOUND_MM = 100.0  # maximum mean error of the joints of a matched hand; a hand is twice as long


class Seen(NamedTuple):
    """A true hand in a frame in which it is visible; ``tracked`` is None if it was not found."""

    number: int
    time: float
    true: TrackedHand
    tracked: TrackedHand | None
    said_lost: bool  # True if it was not found and the track lists it as lost


@dataclass
class Followed:
    """The frames of one true hand, matched.

    seen  where it is visible
    gone  where it is not: the true hand, and that of the track; None if the track does not list it as lost
    """

    id: int
    hand: Side
    seen: list[Seen] = field(default_factory=list)
    gone: list[tuple[LostHand, LostHand | None]] = field(default_factory=list)


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
                own.gone.append((gone, lost.get(last.get(gone.id, -1))))
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



@dataclass(frozen=True)
class JointErrors:
    """Distances between tracked and true joints in mm, over frames and joints; NaN without any."""

    mean: float = NAN
    median: float = NAN


@dataclass(frozen=True)
class HandScores:
    """The scores of one true hand; NaN where there were no such frames.

    in_sight        number of frames in which it is visible
    found           of these, those in which it is tracked, no farther than the bound
    said_lost       of those in which it is not tracked, those in which the track lists it as lost
    gone            frames in which it is not visible, after it was
    said_gone       of these, those in which the track lists it as lost
    right_reason    of these, those with the right reason
    errors          of all joints, where it is found
    errors14        of the joints that NYU is evaluated on; NaN for other skeletons
    id_switches     number of changes of the tracked id
    wrong_side      frames in which it is tracked as the other hand
    side_switches   number of changes of the tracked side
    jitter_mm       at rest: deviation of the joints about their mean, see ``jitter``
    lag_ms          while it moves
    bone_change_mm  (K,) largest deviation of each bone from its median length; empty if it was never found
    """

    id: int
    hand: Side
    in_sight: int
    found: int
    said_lost: int
    gone: int
    said_gone: int
    right_reason: int
    errors: JointErrors
    errors14: JointErrors
    id_switches: int
    wrong_side: int
    side_switches: int
    jitter_mm: float
    lag_ms: float
    bone_change_mm: tuple[float, ...]

    @property
    def missed(self) -> int:
        """Number of frames in which it is visible and not found."""
        return self.in_sight - self.found


@dataclass(frozen=True)
class TrackScores:
    """The scores of all true hands, by id.

    frames    of the truth
    invented  false positives over all frames
    """

    frames: int
    hands: dict[int, HandScores]
    invented: int

    @property
    def found(self) -> float:
        """Share of the visible hands that were found, over all frames."""
        in_sight = sum(hand.in_sight for hand in self.hands.values())
        return sum(hand.found for hand in self.hands.values()) / in_sight if in_sight else NAN

    @property
    def id_switches(self) -> int:
        """The summary over all hands."""
        return sum(hand.id_switches for hand in self.hands.values())


def score(
    header: TrackHeader, frames: Iterable[TrackedFrame], truth: Iterable[TrackedFrame], bound_mm: float = BOUND_MM
) -> TrackScores:
    """Compare a track with the truth of the same recording. Frames missing from the track have no hands.

    header    of the track
    bound_mm  on the joints' mean error of a hand that is found

    Frames in which a true hand is partly visible are not scored (``handpose.tracking.track``). Raises DataError.
    """
    true = list(truth)
    hands, invented = match(frames, true, bound_mm)
    scores = {id: _scores(header, hand) for id, hand in hands.items()}
    return TrackScores(len(true), scores, sum(invented.values()))


def _scores(header: TrackHeader, hand: Followed) -> HandScores:
    found = [one for one in hand.seen if one.tracked is not None]
    tracked = [one.tracked for one in hand.seen if one.tracked is not None]
    reasons = [(true.reason, said.reason) for true, said in hand.gone if said is not None]
    right = [other.hand == hand.hand for other in tracked]
    numbers, times = np.array([one.number for one in found]), np.array([one.time for one in found])
    shape = (len(found), len(header.skeleton.joint_names), 3)
    xyz, true = (
        np.array([one.xyz for one in hands]).reshape(shape) for hands in (tracked, [one.true for one in found])
    )
    off = np.linalg.norm(xyz - true, axis=2)
    return HandScores(
        id=hand.id,
        hand=hand.hand,
        in_sight=len(hand.seen),
        found=len(found),
        said_lost=sum(one.said_lost for one in hand.seen),
        gone=len(hand.gone),
        said_gone=len(reasons),
        right_reason=sum(reason.startswith(true_reason) for true_reason, reason in reasons),
        errors=_errors(off),
        errors14=_errors(off[:, EVALUATION_JOINTS] if off.shape[1] == len(ANNOTATION_OF_JOINT) else off[:0]),
        id_switches=_changes([other.id for other in tracked]),
        wrong_side=right.count(False),
        side_switches=_changes(right),
        jitter_mm=jitter(numbers, times, xyz, true),
        lag_ms=1000 * lag_s(numbers, times, xyz, true),
        bone_change_mm=tuple(bone_changes(xyz, header.skeleton.parents).tolist()) if tracked else (),
    )


def _errors(off: Array) -> JointErrors:
    return JointErrors(float(off.mean()), float(np.median(off))) if off.size else JointErrors()


def _changes(values: Sequence[int]) -> int:
    return sum(before != after for before, after in itertools.pairwise(values))
