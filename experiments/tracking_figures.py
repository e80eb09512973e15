"""Evaluation of the tracker on synthetic recordings, compared with their truth and with single frames.

tracked = follow(SyntheticRecording("minute", NYU, seed=1), Tracker(load_predictor(NYU, fit="fast"), min_confidence=0))
summary(tracked.hands)["mean"]

A single frame has no history, but its predictor gets the true centre of the crop and the true side (``Alone``). If the
tracker's errors are not larger, its history does no harm.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from handpose import Tracker
from handpose.body.nyu import EVALUATION_JOINTS
from handpose.body.sides import Side
from handpose.estimate.predictor import Predictor
from handpose.scoring.matching import BOUND_MM, Seen, match
from handpose.scoring.tracks import HandScores, score
from handpose.sequences.recordings import SyntheticRecording
from handpose.tracking.track import TrackedFrame, TrackedHand
from netlib.blob import Array
from netlib.errors import DataError, NetlibError


class HandFigures(NamedTuple):
    """One true hand of a recording.

    scores  of its track
    off     (F, K) mm: the errors in the frames in which it was found
    same    (P, K) the errors of the track in those of these frames in which the single frame was also found
    alone   (P, K) the errors of these single frames
    looked  number of visible single frames
    seen    of these, those in which it was found
    """

    scores: HandScores
    off: Array
    same: Array
    alone: Array
    looked: int
    seen: int


@dataclass(frozen=True)
class Tracked:
    """A tracked recording.

    hands     by their ids in the truth
    invented  false positives over all frames
    frames    of the recording
    seconds   used by the tracker, without generating the frames
    """

    hands: list[HandFigures]
    invented: int
    frames: int
    seconds: float


class Alone:
    """Predicts hands in single frames, with the true crop centre and side, without earlier frames.

    predictors  for both sides; with one plan, which do not move the crop
    """

    def __init__(self, right: Predictor, left: Predictor) -> None:
        self._predictors: dict[Side, Predictor] = {"right": right, "left": left}
        for side, own in self._predictors.items():
            if own.sides != (side,) or own.refine:
                raise NetlibError(f"a predictor for {' or '.join(own.sides)} hands that moves its crop {own.refine} "
                                  f"times; expected one for {side} hands that leaves it")

    def __call__(self, depth: NDArray[np.float32], true: Iterable[TrackedHand]) -> dict[int, Array]:
        """The errors (K,) in mm of those of the true hands that are found, by their ids."""
        errors = {}
        for hand in true:
            try:
                found = self._predictors[hand.hand].in_frame(depth, hand.center_uvd)
            except DataError:  # out of sight
                continue
            off = _off(found.xyz, hand.xyz)
            if off.mean() <= BOUND_MM:
                errors[hand.id] = off
        return errors


def follow(
    recording: SyntheticRecording,
    tracker: Tracker,
    alone: Alone | None = None,
    every: int = 1,
    progress: Callable[[int], None] = lambda done: None,
) -> Tracked:
    """Track a recording to its end.

    alone     every ``alone``-th frame is also predicted as a single frame
    progress  called with the number of further frames done

    Raises DataError, NetlibError.
    """
    tracked: list[TrackedFrame] = []
    true: list[TrackedFrame] = []
    singles: dict[int, dict[int, Array]] = {}
    seconds = 0.0
    for number in range(recording.count):
        frame, truth = recording.frame(number), recording.truth(number)
        begun = time.perf_counter()
        tracked.append(tracker.step(frame))
        seconds += time.perf_counter() - begun
        true.append(truth)
        if alone is not None and number % every == 0:
            singles[number] = alone(frame.depth, truth.hands)
        progress(1)
    scores, matched = score(tracker.header(recording.name), tracked, true), match(tracked, true)
    hands = [_figures(scores.hands[id], hand.seen, singles) for id, hand in matched.hands.items()]
    return Tracked(hands, scores.invented, recording.count, seconds)


def summary(hands: Sequence[HandFigures]) -> dict[str, float | None]:
    """The figures of several hands together, None without values; in mm, the lag in ms.

    Errors are over frames and joints; mean_14 is of NYU's 14 joints. Of jitters the root mean square, of lags the mean,
    each frame at rest or hand counting alike; the largest change of a bone.
    """
    scores = [hand.scores for hand in hands]
    off, same, alone = (
        np.concatenate([part.ravel() for part in parts]) if parts else np.zeros(0)
        for parts in ([hand.off for hand in hands], [hand.same for hand in hands], [hand.alone for hand in hands])
    )
    few = np.concatenate([hand.off[:, EVALUATION_JOINTS].ravel() for hand in hands]) if hands else np.zeros(0)
    in_sight, found = sum(one.in_sight for one in scores), sum(one.found for one in scores)
    looked, rests = sum(hand.looked for hand in hands), sum(one.rest_frames for one in scores)
    shakes = sum(one.rest_frames * one.jitter_mm**2 for one in scores if one.rest_frames)
    lags = [one.lag_ms for one in scores if not math.isnan(one.lag_ms)]
    figures = {
        "in_sight": in_sight,
        "found": found / in_sight if in_sight else math.nan,
        "mean": _mean(off),
        "median": _median(off),
        "mean_14": _mean(few),
        "median_14": _median(few),
        "same": _mean(same),
        "alone": _mean(alone),
        "same_median": _median(same),
        "alone_median": _median(alone),
        "alone_found": sum(hand.seen for hand in hands) / looked if looked else math.nan,
        "missed": in_sight - found,
        "id_switches": sum(one.id_switches for one in scores),
        "wrong_side": sum(one.wrong_side for one in scores),
        "side_switches": sum(one.side_switches for one in scores),
        "jitter": math.sqrt(shakes / rests) if rests else math.nan,
        "lag": _mean(np.array(lags)),
        "bone_change": max((max(one.bone_change_mm) for one in scores if one.bone_change_mm), default=math.nan),
    }
    return {name: None if math.isnan(value) else value for name, value in figures.items()}


def _figures(scores: HandScores, seen: Sequence[Seen], singles: dict[int, dict[int, Array]]) -> HandFigures:
    joints = len(seen[0].true.xyz) if seen else 0
    found = [(one.number, _off(one.tracked.xyz, one.true.xyz)) for one in seen if one.tracked is not None]
    looked = [one.number for one in seen if one.number in singles]
    both = [(off, singles[n][scores.id]) for n, off in found if n in singles and scores.id in singles[n]]
    return HandFigures(
        scores,
        np.array([off for _, off in found]).reshape(-1, joints),
        np.array([off for off, _ in both]).reshape(-1, joints),
        np.array([off for _, off in both]).reshape(-1, joints),
        len(looked),
        sum(scores.id in singles[n] for n in looked),
    )


def _off(xyz: Array, true: Array) -> Array:
    return np.asarray(np.linalg.norm(xyz - true, axis=1))


def _mean(values: Array) -> float:
    return float(values.mean()) if values.size else math.nan


def _median(values: Array) -> float:
    return float(np.median(values)) if values.size else math.nan
