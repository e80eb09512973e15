#!/usr/bin/env python3
"""Track hands in a depth recording: joints, angles, handedness and confidence for every frame.

    python tools/track.py takes/wave --json wave.json --video wave.mp4
    python tools/track.py take.bag --csv wave.csv --sheet wave.png
    python tools/track.py "frames/left_*.png" --camera sr305 --json left.json
    python tools/track.py realsense --json - | my_program
    python tools/track.py realsense --serve
    python tools/track.py takes/wave --look first.png

SOURCE is a folder with a 16-bit PNG, .npy, .npz or .raw for each frame or a quoted pattern of
their names, an array file (.npy, .npz), a ROS bag, or realsense, a connected camera. Camera,
unit and distortion come from it, from a camera.json next to it, or from options; a report on the
first frames shows them and warns about likely mistakes. --look stops after it, with a figure of
the first hand.

Each hand is tracked from its last pose; while there are fewer than --hands, the image is searched
for more. Handedness is decided in the first frames and size in the first seconds of a track, and
both are kept. Angles and palm poses are smoothed, so bones keep their length; those of recordings
also with the frames after them, up to two seconds later. --raw turns this off. A place below
--min-presence is no hand; beside a hand with joints, nor is a still one below 75% that never had a
pose. A hand below --min-confidence is reported with its place, but without joints. --fit accurate
takes about a third longer than fast. --serve shows the track in a browser as it is computed
(docs/live.md).

Without an output option, FILE.json and a contact sheet FILE.png are written to the working folder,
named after the source, unless they exist. Ctrl-C or a truncated recording leaves complete files of
the frames so far.
"""

from __future__ import annotations

import argparse
import sys
import time
from itertools import islice
from pathlib import Path
from typing import TextIO

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

import tools

tools.begin(__name__)

from handpose import Tracker, load_predictor
from handpose.body.sides import SOUGHT_SIDES
from handpose.estimate.hand import MIN_PRESENCE
from handpose.fit.body import MAX_SIZE, MIN_SIZE
from handpose.frames.cameras import Floats
from handpose.frames.inspection import Inspection, inspect
from handpose.frames.recording import RATE_UNKNOWN
from handpose.tracking.later_frames import LaterFrames
from handpose.tracking.summary import Summary
from handpose.tracking.track import TrackedFrame
from handpose.tracking.tracker import MAX_HANDS
from netlib.errors import DataError
from tools.common import prediction_outputs, sources
from tools.common.arguments import add_engine, count, parser_of, real, seed, whole
from tools.common.console import DONE, aligned, guarded, notify, say
from tools.common.progress import ProgressBar, StoppedError, Stopper
from tools.common.track_outputs import Outputs, add_output_options, refuse_inputs, settle_outputs

NO_POSE = (
    "At a desk, with body, table and objects in view, hands are found without a pose (docs/camera.md#limits); "
    "--min-confidence 0 writes the uncertain ones."
)


def main(argv: list[str] | None = None) -> int:
    """Run the tool; returns the exit status."""
    parser = parser_of(__doc__, nets=True)
    sources.add_source_options(parser)
    add_output_options(parser)
    parser.add_argument(
        "--fit", choices=("fast", "accurate"), default="fast", help="default: %(default)s"
    )
    parser.add_argument(
        "--hand",
        choices=SOUGHT_SIDES,
        default="either",
        help="hands in the recording, if known (default: %(default)s, decided from the depth)",
    )
    parser.add_argument(
        "--hands",
        type=whole(1, MAX_HANDS),
        default=2,
        metavar="N",
        help="maximum number (default: %(default)s)",
    )
    parser.add_argument(
        "--size",
        type=real(MIN_SIZE, MAX_SIZE),
        metavar="S",
        help="relative to the skeleton (default: estimated)",
    )
    sources.add_min_confidence(parser)
    parser.add_argument(
        "--min-presence",
        type=real(0, 1),
        default=MIN_PRESENCE,
        metavar="P",
        help="ignore what is a hand with a lower probability, from 0 to 1 (default: %(default)s)",
    )
    parser.add_argument(
        "--seed", type=seed, default=0, metavar="N", help="of random starts (default: %(default)s)"
    )
    parser.add_argument("--raw", action="store_true", help="do not smooth")
    parser.add_argument("--frames", type=count, metavar="N", help="maximum number of frames")
    add_engine(parser)
    args = parser.parse_args(argv)

    def settled(args: argparse.Namespace) -> int:
        settle_outputs(args, parser)  # guarded, because there may be no working directory
        return run(args)

    return guarded(settled, args)


def run(args: argparse.Namespace) -> int:
    """Track the recording."""
    report = sys.stderr if args.json == "-" else sys.stdout
    with sources.opened(args) as recording:
        refuse_inputs(args, recording)
        inspection = inspect(recording)
        sources.print_inspection(inspection, report)
        predictor = load_predictor(
            recording.camera,
            fit=args.fit,
            hand=args.hand,
            engine=args.engine,
            min_confidence=args.min_confidence,
            seed=args.seed,
        )
        if args.look is not None:
            return prediction_outputs.draw_first(inspection, predictor, args.look)
        tracker = Tracker(
            predictor,
            hands=args.hands,
            smooth=not args.raw,
            size=args.size,
            min_confidence=0,  # LaterFrames applies it
            min_presence=args.min_presence,
        )
        return _track_recording(args, inspection, tracker, report)


def _track_recording(
    args: argparse.Namespace, inspection: Inspection, tracker: Tracker, report: TextIO
) -> int:
    """Track the frames, write the outputs, and print a summary and warnings; returns the exit
    status. Raises NetlibError.
    """
    recording = inspection.recording
    status = DONE
    summary = Summary(tracker.predictor.skeleton)
    begin = time.perf_counter()
    outputs = Outputs(args, tracker.header(recording.name), recording.rate)
    at_once = recording.live or args.serve is not None
    later = LaterFrames[Floats](tracker.model, args.min_confidence, at_once, tracker.settings)
    try:
        with Stopper() as stopper:
            _track(inspection, tracker, later, outputs, summary, stopper, args.frames)
    except StoppedError:
        after = f" after {summary.frames} frames" if summary.frames else ""
        notify(f"stopped{after}")
        status = 128 + stopper.signum
    sources.print_new_remarks(inspection)
    if not summary.frames:
        if status == DONE:
            raise DataError(f"{recording.name}: no frames were tracked")
        return status
    seconds = time.perf_counter() - begin or 1e-3  # 0: a coarse clock
    found = aligned(summary.rows).split("\n") if summary.hands else _nothing(summary, inspection)
    speed = f"{summary.frames} frames of {summary.seconds:.1f} s, {summary.frames / seconds:.1f} frames/s"
    notes = filter(None, [later.sure_hands.note])  # on hands below the minimum confidence
    written = (f"wrote {name}" for name in outputs.written)
    say(speed, *found, *notes, *written, sep="\n", file=report)
    warnings = summary.doubts if args.size is None else []
    if RATE_UNKNOWN in recording.remarks:
        warnings.append(RATE_UNKNOWN)
    for warning in warnings:
        notify(f"warning: {recording.name}: {warning}")
    return status


def _track(
    inspection: Inspection,
    tracker: Tracker,
    later: LaterFrames[Floats],
    outputs: Outputs,
    summary: Summary,
    stopper: Stopper,
    max_frames: int | None,
) -> None:
    """Track and write up to the end of the recording, or ``max_frames``.

    Raises StoppedError, NetlibError.
    """
    recording = inspection.recording

    def write(frames: list[tuple[Floats, TrackedFrame]]) -> None:
        for depth, tracked in frames:
            outputs.write(depth, tracked)
            summary.add(tracked)

    total = min((count for count in (recording.count, max_frames) if count), default=0)
    with outputs, ProgressBar(total, what="tracking") as progress:
        outputs.begin(recording, stopper.check)
        try:
            for frame in islice(inspection.all_frames(), max_frames):
                stopper.check()
                try:
                    tracked = tracker.step(frame)
                except DataError as error:
                    raise DataError(f"{recording.name}: frame {frame.number}: {error}") from error
                write(later.add(frame.depth, tracked))
                progress(1)
        finally:
            write(later.finish())


def _nothing(summary: Summary, inspection: Inspection) -> list[str]:
    """What is reported without hands, and what may explain it."""
    why = "; ".join(filter(None, [summary.nothing_found, inspection.doubt]))
    return [why, NO_POSE] if summary.present else [why]


if __name__ == "__main__":
    sys.exit(main())
