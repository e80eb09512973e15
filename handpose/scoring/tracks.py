"""Scores of a track against the truth: errors, missed and false hands, identities,
sides, jitter, lag.

    header = tracker.header(recording.name)  # of a SyntheticRecording
    scores = score(header, tracker.follow(recording), recording.truths())
    scores.hands[0].lag_ms

The arrays of a hand are ``numbers`` (N,) and ``times`` (N,), in s, of the frames in which it is
found, and its ``tracked`` and ``true`` joints (N, K, 3), in mm.
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
MIN_SPLINE_FRAMES = 4
MAX_MATCH_MM = 100.0  # maximum mean error of the joints of a matched hand; a hand is twice as long
NAN = float("nan")


def jitter(numbers: Array, times: Array, tracked: Array, true: Array) -> float:
    """The jitter in mm of tracked joints while the true ones are at rest; NaN without rest.

    It is the root mean square of the distances from their mean over windows of about ``WINDOW_S``:
    the standard deviation of all three coordinates together. The mean is removed window by window,
    which is a high-pass filter: a wrong length of a bone is an error, but no jitter. A missing
    frame ends a rest.
    """
    squares = 0.0
    freedom = 0
    for window in _windows(numbers, times, true):
        error = tracked[window] - true[window]
        squares += _squares_about_mean(error)
        freedom += (len(window) - 1) * error.shape[1]
    return float(np.sqrt(squares / freedom)) if freedom else NAN


def _squares_about_mean(error: Array) -> float:
    """The sum of the squared differences from the mean over frames."""
    return float(((error - error.mean(axis=0)) ** 2).sum())


def _windows(numbers: Array, times: Array, true: Array) -> list[NDArray[np.int_]]:
    """The frames of rests, except for their first ``SETTLE_S``, in equal parts of
    about ``WINDOW_S``.
    """
    windows = []
    for first, end in rests(numbers, true):
        settled = times[first] + SETTLE_S - ROUNDING_S
        start = first + int(np.searchsorted(times[first:end], settled))
        parts = round((times[end - 1] - times[start]) / WINDOW_S) if start < end else 0
        if parts:
            windows += np.array_split(np.arange(start, end), parts)
    return [window for window in windows if len(window) > 1]


def rests(numbers: Array, true: Array) -> list[tuple[int, int]]:
    """Runs of frames, first and end (exclusive), in which the hand does not move."""
    if len(true) < 2:
        return []
    step_mm = np.linalg.norm(np.diff(true, axis=0), axis=2).max(axis=1)
    return _runs((step_mm <= REST_MM) & (np.diff(numbers) == 1))


def lag_s(numbers: Array, times: Array, tracked: Array, true: Array) -> float:
    """The delay in s of the tracked joints that minimises the squared difference to the true ones.

    Over frames in which the hand moves; the true joints between frames are a cubic spline. A
    constant error in a run of frames does not count as lag: it is removed. NaN without movement, or
    without a minimum within ``LAGS_S``.
    """
    squares = np.zeros(len(LAGS_S))
    for first, end in _runs(np.diff(numbers) == 1):
        if end - first >= MIN_SPLINE_FRAMES:
            run = slice(first, end)
            squares += _squares_by_lag(times[run], tracked[run], true[run])
    best = int(squares.argmin())
    if not squares.any() or best in (0, len(LAGS_S) - 1):
        return NAN
    before, least, after = squares[best - 1 : best + 2]
    # the minimum of the parabola through the three
    step = LAGS_S[1] - LAGS_S[0]
    curvature = before - 2 * least + after
    return float(LAGS_S[best] + step * (before - after) / (2 * curvature))


def _squares_by_lag(times: Array, tracked: Array, true: Array) -> Array:
    """The squared differences, at each of ``LAGS_S``, of a run of frames; 0 without movement."""
    from scipy.interpolate import CubicSpline  # imported here: it takes a third of a second

    spline = CubicSpline(times, true)
    moves = np.linalg.norm(spline(times, 1), axis=2).mean(axis=1) >= MOVING_MM_S
    # the spline is known at all lags
    is_after_start = times - LAGS_S[-1] >= times[0] - ROUNDING_S
    is_before_end = times - LAGS_S[0] <= times[-1] + ROUNDING_S
    used = moves & is_after_start & is_before_end
    if not used.any():
        return np.zeros(len(LAGS_S))
    errors = (tracked[used] - spline(times[used] - lag) for lag in LAGS_S)
    return np.array([_squares_about_mean(error) for error in errors])


def _runs(links: Array) -> list[tuple[int, int]]:
    """Runs of N frames, first and end (exclusive), in which each is linked (N - 1,) to the next."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], links, [False]]).astype(int)))
    return [(int(first), int(last) + 1) for first, last in edges.reshape(-1, 2)]


# ----------------------------------------------------------------------------------------- matching


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
        reported = tracked_frames[number].hands if number in tracked_frames else ()
        matches = _matches(frame.hands, reported)
        for n, hand in enumerate(frame.hands):
            found = reported[matches[n]] if n in matches else None
            hands.setdefault(hand.id, []).append(Seen(number, frame.time, hand, found))
        partly_visible = sum(lost.reason.startswith(PARTLY) for lost in frame.lost)
        invented += max(len(reported) - len(matches) - partly_visible, 0)
    return dict(sorted(hands.items())), invented


def _matches(true: tuple[TrackedHand, ...], tracked: tuple[TrackedHand, ...]) -> dict[int, int]:
    """The indices of tracked hands by those of the true ones that they are matched to."""
    from scipy.optimize import linear_sum_assignment  # imported here: it takes a third of a second

    if not true or not tracked:
        return {}
    for hand in tracked:
        if hand.xyz.shape != true[0].xyz.shape:
            raise DataError(
                f"a track of joints {hand.xyz.shape}, its truth has {true[0].xyz.shape}; "
                "expected one skeleton"
            )
    error_mm = np.array(
        [[np.linalg.norm(a.xyz - b.xyz, axis=1).mean() for b in tracked] for a in true]
    )
    # errors of ten times the maximum or more count as equal
    pairs = zip(*linear_sum_assignment(np.minimum(error_mm, 10 * MAX_MATCH_MM)))
    return {int(n): int(m) for n, m in pairs if error_mm[n, m] <= MAX_MATCH_MM}


def _by_number(frames: Iterable[TrackedFrame], what: str) -> dict[int, TrackedFrame]:
    """The frames by their numbers. Raises DataError if two have the same."""
    by_number: dict[int, TrackedFrame] = {}
    for frame in frames:
        if frame.number in by_number:
            raise DataError(f"the {what} has two frames {frame.number}; expected one")
        by_number[frame.number] = frame
    return by_number


@dataclass(frozen=True)
class HandScores:
    """The scores of one true hand; NaN where there were no such frames.

    in_sight        number of frames in which it is visible
    found           of these, those in which it is tracked, no farther than ``MAX_MATCH_MM``
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

    Frames missing from the track have no hands. Frames in which a true hand is partly visible are
    not scored (``handpose.tracking.track``). Raises DataError.

    header  of the track
    """
    true = list(truth)
    hands, invented = match(frames, true)
    joints = len(header.skeleton.joint_names)
    return TrackScores(
        len(true), {id: _scores(joints, seen) for id, seen in hands.items()}, invented
    )


def _scores(joints: int, seen: list[Seen]) -> HandScores:
    """The scores of one true hand in the frames in which it is visible."""
    side = seen[0].true.the_pose.side
    found = [frame for frame in seen if frame.tracked is not None]
    hands = [frame.tracked for frame in seen if frame.tracked is not None]
    numbers = np.array([frame.number for frame in found])
    times = np.array([frame.time for frame in found])
    shape = (len(found), joints, 3)
    tracked = np.array([hand.xyz for hand in hands]).reshape(shape)
    true = np.array([frame.true.xyz for frame in found]).reshape(shape)
    error_mm = float(np.linalg.norm(tracked - true, axis=2).mean()) if found else NAN
    is_right_side = [hand.hand == side for hand in hands]
    return HandScores(
        hand=side,
        in_sight=len(seen),
        found=len(found),
        error_mm=error_mm,
        id_switches=_changes([hand.id for hand in hands]),
        wrong_side=is_right_side.count(False),
        side_switches=_changes(is_right_side),
        jitter_mm=jitter(numbers, times, tracked, true),
        lag_ms=1000 * lag_s(numbers, times, tracked, true),
    )


def _changes(values: Sequence[int]) -> int:
    return sum(before != after for before, after in itertools.pairwise(values))
