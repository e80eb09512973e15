"""Scores of a track against the truth: errors, missed and false hands, identities,
sides, jitter, lag.

# recording: a SyntheticRecording
scores = score(tracker.header, tracker.follow(recording), recording.truths())
scores.hands[0].lag_ms
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from handpose.body.sides import Side
from handpose.tracking.track import PARTLY, TrackedFrame, TrackedHand, TrackHeader
from netlib.blob import Array
from netlib.errors import DataError

REST_MM = 0.05  # maximum step of any joint of a hand at rest from frame to frame
SETTLE_S = 0.4  # start of every rest that is not scored, because the track may still settle
WINDOW_S = 0.5  # window; slower errors are drift, not jitter
MOVING_MM_S = 100.0  # minimum mean speed of the joints of a moving hand
LAGS_S = np.arange(-0.1, 0.3001, 0.005)  # lags tried; the best is refined by a parabola
ROUNDING_S = 1e-9  # of differences of times
NAN = float("nan")


def jitter(numbers: Array, times: Array, tracked: Array, true: Array) -> float:
    """The jitter in mm of tracked joints while the true ones are at rest; NaN without rest.

    It is the root mean square of the distances from their mean over windows of about ``WINDOW_S``:
    the standard deviation of all three coordinates together. The mean is removed window by window,
    which is a high-pass filter: a wrong length of a bone is an error, but no jitter. Frames (N,)
    have numbers; a missing frame ends a rest.
    """
    squares = 0.0
    freedom = 0
    for window in _windows(numbers, times, true):
        off = tracked[window] - true[window]
        squares += float(((off - off.mean(axis=0)) ** 2).sum())
        freedom += (len(window) - 1) * off.shape[1]
    return float(np.sqrt(squares / freedom)) if freedom else NAN


def _windows(numbers: Array, times: Array, true: Array) -> list[NDArray[np.int_]]:
    """The frames of rests, except for their first ``SETTLE_S``, in equal parts of
    about ``WINDOW_S``.
    """
    windows = []
    for first, last in rests(numbers, true):
        begin = first + int(
            np.searchsorted(times[first:last], times[first] + SETTLE_S - ROUNDING_S)
        )
        parts = round((times[last - 1] - times[begin]) / WINDOW_S) if begin < last else 0
        if parts:
            windows += np.array_split(np.arange(begin, last), parts)
    return [window for window in windows if len(window) > 1]


def rests(numbers: Array, true: Array) -> list[tuple[int, int]]:
    """Runs of frames, from and to (exclusive), in which the hand does not move."""
    if len(true) < 2:
        return []
    moved_mm = np.linalg.norm(np.diff(true, axis=0), axis=2).max(axis=1)
    still = (moved_mm <= REST_MM) & (np.diff(numbers) == 1)
    return [(first, last + 1) for first, last in _runs(still)]


def lag_s(numbers: Array, times: Array, tracked: Array, true: Array) -> float:
    """The delay in s of the tracked joints that minimises the squared difference to the true ones.

    Over frames in which the hand moves; the true joints between frames are a cubic spline. A
    constant error in a run of frames does not count as lag: it is removed. NaN without movement, or
    without a minimum within ``LAGS_S``.
    """
    from scipy.interpolate import CubicSpline  # imported here: it takes a third of a second

    squares = np.zeros(len(LAGS_S))
    for first, last in [(a, b + 1) for a, b in _runs(np.diff(numbers) == 1)]:
        t = times[first:last]
        truth = true[first:last]
        if last - first < 4:
            continue
        spline = CubicSpline(t, truth)
        fast = np.linalg.norm(spline(t, 1), axis=2).mean(axis=1) >= MOVING_MM_S
        is_after = t - LAGS_S[-1] >= t[0] - ROUNDING_S
        is_before = t - LAGS_S[0] <= t[-1] + ROUNDING_S
        used = fast & is_after & is_before  # the spline is known at all lags
        if not used.any():
            continue
        for n, lag in enumerate(LAGS_S):
            off = tracked[first:last][used] - spline(t[used] - lag)
            squares[n] += float(((off - off.mean(axis=0)) ** 2).sum())
    best = int(squares.argmin())
    if not squares.any() or best in (0, len(LAGS_S) - 1):
        return NAN
    before, least, after = squares[best - 1 : best + 2]
    # the minimum of the parabola through the three
    step = LAGS_S[1] - LAGS_S[0]
    curvature = before - 2 * least + after
    return float(LAGS_S[best] + step * (before - after) / (2 * curvature))


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


def match(
    tracked: Iterable[TrackedFrame], true: Iterable[TrackedFrame]
) -> tuple[dict[int, list[Seen]], int]:
    """The frames of each true hand, by its id, and the number of false positives over all
    frames of the truth.

    A frame missing from the track has no hands. Where a true hand is partly visible, tracked hands
    near it do not count. Raises DataError for frames of the track that the truth does not have, and
    for two frames of the same number.
    """
    tracked_frames, true_frames = _by_number(tracked, "track"), _by_number(true, "truth")
    foreign = sorted(set(tracked_frames) - set(true_frames))
    if foreign:
        raise DataError(
            f"frame {foreign[0]} of the track is not in the truth; expected a track of the same recording"
        )
    hands: dict[int, list[Seen]] = {}
    invented = 0
    for number, frame in sorted(true_frames.items()):
        other = tracked_frames.get(number, TrackedFrame(number, frame.time, ()))
        pairs = _pairs(frame.hands, other.hands)
        for n, hand in enumerate(frame.hands):
            found = other.hands[pairs[n]] if n in pairs else None
            hands.setdefault(hand.id, []).append(Seen(number, frame.time, hand, found))
        partly = sum(lost.reason.startswith(PARTLY) for lost in frame.lost)
        invented += max(len(other.hands) - len(pairs) - partly, 0)
    return dict(sorted(hands.items())), invented


def _pairs(true: tuple[TrackedHand, ...], tracked: tuple[TrackedHand, ...]) -> dict[int, int]:
    """The tracked hands matched to true ones, by index."""
    from scipy.optimize import linear_sum_assignment  # imported here: it takes a third of a second

    if not true or not tracked:
        return {}
    for hand in tracked:
        if hand.xyz.shape != true[0].xyz.shape:
            raise DataError(
                f"a track of joints {hand.xyz.shape}, its truth has {true[0].xyz.shape}; "
                "expected one skeleton"
            )
    apart = np.array(
        [[np.linalg.norm(a.xyz - b.xyz, axis=1).mean() for b in tracked] for a in true]
    )
    rows, columns = linear_sum_assignment(np.minimum(apart, 10 * BOUND_MM))
    return {int(n): int(m) for n, m in zip(rows, columns) if apart[n, m] <= BOUND_MM}


def _by_number(frames: Iterable[TrackedFrame], what: str) -> dict[int, TrackedFrame]:
    found: dict[int, TrackedFrame] = {}
    for frame in frames:
        if frame.number in found:
            raise DataError(f"the {what} has two frames {frame.number}; expected one")
        found[frame.number] = frame
    return found


@dataclass(frozen=True)
class HandScores:
    """The scores of one true hand; NaN where there were no such frames.

    in_sight        number of frames in which it is visible
    found           of these, those in which it is tracked, no farther than the bound
    error_mm        mean over all joints, where it is found
    id_switches     number of changes of the tracked id
    wrong_side      frames in which it is tracked as the other hand
    side_switches   number of changes of the tracked side
    jitter_mm       at rest: deviation of the joints about their mean, see ``jitter``
    lag_ms          while it moves
    """

    hand: Side
    in_sight: int
    found: int
    error_mm: float
    id_switches: int
    wrong_side: int
    side_switches: int
    jitter_mm: float
    lag_ms: float

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


def score(
    header: TrackHeader, frames: Iterable[TrackedFrame], truth: Iterable[TrackedFrame]
) -> TrackScores:
    """Compare a track with the truth of the same recording.

    Frames missing from the track have no hands.

    header  of the track

    Frames in which a true hand is partly visible are not scored (``handpose.tracking.track``).
    Raises DataError.
    """
    true = list(truth)
    hands, invented = match(frames, true)
    return TrackScores(
        len(true), {id: _scores(header, seen) for id, seen in hands.items()}, invented
    )


def _scores(header: TrackHeader, seen: list[Seen]) -> HandScores:
    """The scores of one true hand in the frames in which it is visible."""
    side = seen[0].true.the_pose.side
    found = [(one, one.tracked) for one in seen if one.tracked is not None]
    numbers = np.array([one.number for one, _ in found])
    times = np.array([one.time for one, _ in found])
    shape = (len(found), len(header.skeleton.joint_names), 3)
    xyz = np.array([other.xyz for _, other in found]).reshape(shape)
    true = np.array([one.true.xyz for one, _ in found]).reshape(shape)
    right = [other.hand == side for _, other in found]
    error_mm = float(np.linalg.norm(xyz - true, axis=2).mean()) if found else NAN
    return HandScores(
        hand=side,
        in_sight=len(seen),
        found=len(found),
        error_mm=error_mm,
        id_switches=_changes([other.id for _, other in found]),
        wrong_side=right.count(False),
        side_switches=_changes(right),
        jitter_mm=jitter(numbers, times, xyz, true),
        lag_ms=1000 * lag_s(numbers, times, xyz, true),
    )


def _changes(values: Sequence[int]) -> int:
    return sum(before != after for before, after in itertools.pairwise(values))
