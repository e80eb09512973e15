"""The tracker on synthetic recordings: errors, missed and invented hands, handedness,
jitter, lag, speed.

    python -m experiments tracking
    python -m experiments tracking --scripts minute two_hands --cameras nyu kinect2 --seeds 0 1
    python -m experiments tracking --scripts moving --rate 60 --seconds 5 --raw --fit accurate

The scripts are those of tools/make_recording.py. There is a row for each of their hands. Joint
errors are in mm, over frames in which the hand is visible and "found", that is, reported with a
mean error of at most 100 mm. "ids" and "flips" count changes of its id and of its reported side;
"wrong side" counts frames in which that is wrong. "jitter" is in mm while the hand rests, "lag" in
ms while it moves. The last line has all hands, the hands reported where there is none, and the
speed of the tracker without rendering.
"""

from __future__ import annotations

import argparse
import itertools
import time
from collections.abc import Callable
from typing import NamedTuple

from experiments.choices import add_choices
from experiments.tables import figure, tabulated
from handpose import CAMERAS, Tracker, load_predictor
from handpose.scoring.tracks import HandScores, TrackScores, score
from handpose.sequences.recordings import SCRIPTS, SyntheticRecording
from tools.common.arguments import add_engine, seconds, seed
from tools.common.console import say
from tools.common.progress import ProgressBar
from tools.common.sources import rate


class Tracked(NamedTuple):
    """A tracked recording.

    scores   of all hands
    seconds  used by the tracker, without rendering the frames
    """

    scores: TrackScores
    seconds: float


def follow(
    recording: SyntheticRecording,
    tracker: Tracker,
    progress: Callable[[int], None] = lambda done: None,
) -> Tracked:
    """Track a recording to its end. Raises NetlibError.

    progress  called with the number of further frames done
    """
    tracked = []
    elapsed = 0.0
    for frame in recording:
        begun = time.perf_counter()
        tracked.append(tracker.step(frame))
        elapsed += time.perf_counter() - begun
        progress(1)
    header = tracker.header(recording.name)
    return Tracked(score(header, tracked, recording.truths()), elapsed)


def cells_of(hand: HandScores) -> dict[str, str]:
    """The columns of a hand; empty where a score does not exist."""
    return {
        "in sight": str(hand.in_sight),
        "found": f"{hand.found / hand.in_sight:.1%}" if hand.in_sight else "",
        "mean": figure("{:.1f}", hand.error_mm),
        "ids": str(hand.id_switches),
        "wrong side": str(hand.wrong_side),
        "flips": str(hand.side_switches),
        "jitter": figure("{:.2f}", hand.jitter_mm),
        "lag": figure("{:.0f}", hand.lag_ms),
    }


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    add_choices(parser, "--scripts", SCRIPTS)
    add_choices(parser, "--cameras", CAMERAS, ["nyu"])
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
    add_engine(parser)


def run(args: argparse.Namespace) -> None:
    """Measure the tracker. Raises NetlibError."""
    recordings = []
    for camera, script, number in itertools.product(args.cameras, args.scripts, args.seeds):
        recording = SyntheticRecording(
            script, CAMERAS[camera], rate=args.rate, seconds=args.seconds, seed=number
        )
        recordings.append((script, camera, number, recording))
    rows, done = [], []
    frames = sum(recording.count for *_, recording in recordings)
    with ProgressBar(frames, what="tracking") as progress:
        for script, camera, number, recording in recordings:
            predictor = load_predictor(recording.camera, fit=args.fit, engine=args.engine)
            tracker = Tracker(predictor, smooth=not args.raw, min_confidence=0)
            tracked = follow(recording, tracker, progress)
            done.append(tracked)
            for id, hand in tracked.scores.hands.items():
                names = {"script": script, "camera": camera, "seed": str(number)}
                rows.append({**names, "hand": f"{id} {hand.hand}", **cells_of(hand)})
    print(tabulated(rows))
    say(_summary(done))


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
