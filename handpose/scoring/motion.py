"""The motion of a track compared with the truth: lag, jitter at rest, and constancy of the bones.

All functions take joints of one hand over time, tracked and true, (N, K, 3) in mm.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from netlib.blob import Array

REST_MM = 0.05  # maximum step of any joint of a hand at rest from frame to frame
SETTLE_S = 0.4  # start of every rest that is not scored, because the track may still settle
WINDOW_S = 0.5  # window; slower errors are drift, not jitter
MOVING_MM_S = 100.0  # minimum mean speed of the joints of a moving hand
LAGS_S = np.arange(-0.1, 0.3001, 0.005)  # lags tried; the best is refined by a parabola


class Jitter(NamedTuple):
    """The jitter of tracked joints while the true ones are at rest; NaN without rest.

    deviation_mm  root mean square of the distances from their mean over windows of about ``WINDOW_S``: the standard
                  deviation of all three coordinates together
    step_mm       root mean square of the distance from one frame to the next
    frames        number of frames at rest
    """

    deviation_mm: float
    step_mm: float
    frames: int


def jitter(numbers: Array, times: Array, tracked: Array, true: Array) -> Jitter:
    """The jitter at rest. Frames (N,) with their numbers; a missing frame ends a rest.

    The mean is removed window by window, which is a high-pass filter: a wrong length of a bone is an error, but no
    jitter.
    """
    squares = steps = 0.0
    freedom = frames = 0
    for window in _windows(numbers, times, true):
        off = tracked[window] - true[window]
        squares += float(((off - off.mean(axis=0)) ** 2).sum())
        steps += float((np.diff(off, axis=0) ** 2).sum())
        freedom += (len(window) - 1) * off.shape[1]
        frames += len(window)
    if not frames:
        return Jitter(np.nan, np.nan, 0)
    return Jitter(float(np.sqrt(squares / freedom)), float(np.sqrt(steps / freedom)), frames)


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
        return float("nan")
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
