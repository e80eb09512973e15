"""The tracker on synthetic recordings: errors, missed and invented hands, handedness,
jitter, lag, speed.

    python -m experiments tracking
    python -m experiments tracking --scripts minute two_hands --cameras nyu kinect2 \\
        --seeds 0 1 --frame-by-frame
    python -m experiments tracking --scripts moving --rate 60 --seconds 5 --raw --fit accurate

The scripts are those of tools/make_recording.py. There is a row for each of their hands. Joint
errors are in mm, over frames in which the hand is visible and "found", that is, reported with a
mean error of at most 100 mm. "ids" and "flips" count changes of its id and of its reported side;
"wrong side" counts frames in which that is wrong. "jitter" is in mm while the hand rests, "lag" in
ms while it moves. The last line has all hands, the hands reported where there is none, and the
speed of the tracker without rendering.

--frame-by-frame also fits each frame, or every N-th, with the same plan, without history, but given
the true centre of the crop and side: "same" and "alone" are the mean errors of the track and of
these fits in frames in which both find the hand.
"""

from __future__ import annotations

import argparse
import contextlib
import itertools
import time
from collections.abc import Callable
from typing import Literal, NamedTuple

import numpy as np

from handpose import CAMERAS, Camera, Tracker, load_predictor
from handpose.body.sides import SIDES
from handpose.frames.recording import DepthFrame
from handpose.scoring.tracks import MAX_MATCH_MM, TrackScores, match, score
from handpose.sequences.recordings import SCRIPTS, SyntheticRecording
from handpose.tracking.track import TrackedFrame
from netlib.blob import Array
from netlib.errors import DataError
from tools.common.arguments import add_engine, count, seconds, seed
from tools.common.console import DONE, aligned, say
from tools.common.progress import ProgressBar
from tools.common.sources import rate

COLUMNS = (
    "in sight",
    "found",
    "mean",
    "same",
    "alone",
    "ids",
    "wrong side",
    "flips",
    "jitter",
    "lag",
)
# errors (K,) in mm of fits of a single frame, by the ids of the true hands
Alone = Callable[[DepthFrame, TrackedFrame], dict[int, Array]]


class Tracked(NamedTuple):
    """A tracked recording.

    scores    of all hands
    error_mm  by hand: mean errors (n, 2) of the track and of a fit of a single frame, in frames in
              which both find it
    seconds   used by the tracker, without rendering the frames
    """

    scores: TrackScores
    error_mm: dict[int, Array]
    seconds: float


def follow(
    recording: SyntheticRecording,
    tracker: Tracker,
    alone: Alone | None = None,
    every: int = 1,
    progress: Callable[[int], None] = lambda done: None,
) -> Tracked:
    """Track a recording to its end; every ``every``-th frame is also predicted ``alone``.

    Raises NetlibError.

    progress  called with the number of further frames done
    """
    tracked, true = [], []
    fits: dict[int, dict[int, Array]] = {}
    elapsed = 0.0
    for number in range(recording.count):
        frame, truth = recording.frame(number), recording.truth(number)
        begun = time.perf_counter()
        tracked.append(tracker.step(frame))
        elapsed += time.perf_counter() - begun
        true.append(truth)
        if alone is not None and number % every == 0:
            fits[number] = alone(frame, truth)
        progress(1)
    error_mm = {}
    for id, seen in match(tracked, true)[0].items():
        errors = [
            (_error(frame.tracked.xyz, frame.true.xyz).mean(), fits[frame.number][id].mean())
            for frame in seen
            if frame.tracked and id in fits.get(frame.number, {})
        ]
        error_mm[id] = np.array(errors).reshape(-1, 2)
    return Tracked(score(tracker.header(recording.name), tracked, true), error_mm, elapsed)


def alone_of(camera: Camera, fit: Literal["fast", "accurate"], engine: str | None) -> Alone:
    """A prediction of hands in single frames of a camera, with the true crop centre and side.

    Raises NetlibError.
    """
    predictors = {
        side: load_predictor(camera, hand=side, refine=0, fit=fit, engine=engine, min_confidence=0)
        for side in SIDES
    }

    def alone(frame: DepthFrame, true: TrackedFrame) -> dict[int, Array]:
        errors = {}
        for hand in true.hands:
            pose = hand.the_pose
            with contextlib.suppress(DataError):  # out of sight
                found = predictors[pose.side].in_frame(frame.depth, pose.center_uvd)
                errors[hand.id] = _error(found.xyz, hand.xyz)
        return {id: error for id, error in errors.items() if error.mean() <= MAX_MATCH_MM}

    return alone


def _error(xyz: Array, true: Array) -> Array:
    """Distances (K,) of joints (K, 3)."""
    return np.asarray(np.linalg.norm(xyz - true, axis=1))


def cells_of(tracked: Tracked, id: int) -> list[str]:
    """The columns of a hand; empty where a score does not exist."""
    hand = tracked.scores.hands[id]
    error_mm = tracked.error_mm[id]
    same, alone = error_mm.mean(axis=0) if len(error_mm) else (np.nan, np.nan)
    found = hand.found / hand.in_sight if hand.in_sight else np.nan
    values = (
        ("{}", hand.in_sight),
        ("{:.1%}", found),
        ("{:.1f}", hand.error_mm),
        ("{:.1f}", same),
        ("{:.1f}", alone),
        ("{}", hand.id_switches),
        ("{}", hand.wrong_side),
        ("{}", hand.side_switches),
        ("{:.2f}", hand.jitter_mm),
        ("{:.0f}", hand.lag_ms),
    )
    return ["" if np.isnan(value) else form.format(value) for form, value in values]


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    parser.add_argument(
        "--scripts",
        choices=SCRIPTS,
        nargs="+",
        default=list(SCRIPTS),
        metavar="NAME",
        help=f"some of {', '.join(SCRIPTS)} (default: all)",
    )
    parser.add_argument(
        "--cameras",
        choices=CAMERAS,
        nargs="+",
        default=["nyu"],
        metavar="NAME",
        help=f"some of {', '.join(CAMERAS)} (default: nyu)",
    )
    parser.add_argument(
        "--seeds", type=seed, nargs="+", default=[0], metavar="N", help="default: 0"
    )
    parser.add_argument(
        "--rate", type=rate, default=30.0, metavar="HZ", help="frames per second (default: 30)"
    )
    parser.add_argument(
        "--seconds", type=seconds, metavar="S", help="duration (default: the script's)"
    )
    parser.add_argument(
        "--fit", choices=("fast", "accurate"), default="fast", help="default: %(default)s"
    )
    parser.add_argument("--raw", action="store_true", help="do not smooth")
    parser.add_argument(
        "--frame-by-frame",
        type=count,
        nargs="?",
        const=1,
        metavar="N",
        help="also fit each frame, or every N-th, independently",
    )
    add_engine(parser)


def run(args: argparse.Namespace) -> int:
    """Measure the tracker. Raises NetlibError."""
    recordings = []
    for camera, script, number in itertools.product(args.cameras, args.scripts, args.seeds):
        recording = SyntheticRecording(
            script, CAMERAS[camera], rate=args.rate, seconds=args.seconds, seed=number
        )
        recordings.append((script, camera, number, recording))
    rows, done = [["script", "camera", "seed", "hand", *COLUMNS]], []
    frames = sum(recording.count for *_, recording in recordings)
    with ProgressBar(frames, what="tracking") as progress:
        for script, camera, number, recording in recordings:
            predictor = load_predictor(recording.camera, fit=args.fit, engine=args.engine)
            tracker = Tracker(predictor, smooth=not args.raw, min_confidence=0)
            alone = None
            if args.frame_by_frame:
                alone = alone_of(recording.camera, args.fit, args.engine)
            tracked = follow(recording, tracker, alone, args.frame_by_frame or 1, progress)
            done.append(tracked)
            for id, hand in tracked.scores.hands.items():
                names = [script, camera, str(number), f"{id} {hand.hand}"]
                rows.append([*names, *cells_of(tracked, id)])
    print(aligned(rows))
    say(_summary(done))
    return DONE


def _summary(done: list[Tracked]) -> str:
    """The line about all hands."""
    hands = [hand for tracked in done for hand in tracked.scores.hands.values()]
    found = sum(hand.found for hand in hands)
    in_sight = sum(hand.in_sight for hand in hands)
    error = sum(hand.found * hand.error_mm for hand in hands if hand.found) / max(found, 1)
    invented = sum(tracked.scores.invented for tracked in done)
    frames = sum(tracked.scores.frames for tracked in done)
    speed = frames / sum(tracked.seconds for tracked in done)
    return (
        f"{found} of {in_sight} visible hands found, mean error {error:.1f} mm; "
        f"{invented} reported where there is none; {frames} frames, {speed:.0f} per second"
    )
