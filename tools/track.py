#!/usr/bin/env python3
"""Follow hands through a depth recording: joints, angles, which hand, how sure, for every frame.

    python tools/track.py takes/wave --json wave.json --video wave.mp4
    python tools/track.py take.mkv --bvh wave.bvh --csv wave.csv --sheet wave.png
    python tools/track.py "frames/left_*.png" --camera sr305 --json left.json
    python tools/track.py realsense --json - | my_program
    python tools/track.py realsense --serve
    python tools/track.py takes/wave --look first.png

SOURCE is a folder of 16-bit PNG or names in it (quoted, with a *), a stack of frames (.npy, .npz, .h5), a video (.mkv,
also of an Azure Kinect), a bag of ROS, or realsense. Camera, unit and distortion come from it, or from a camera.json
beside it, or from the options; a first look says what they are, and what is likely wrong. --look stops after it, with
a picture of the first hand.

Every hand is followed from its last pose; while fewer than --hands are, the image is searched for more. Whether it is
a left one or a right one is decided over its first frames, its size over its first seconds, and both are kept. Angles
and the palm's pose are smoothed, so that bones keep their length; --raw leaves them as they were found. --fit
accurate takes about a third longer than fast. --serve shows the track in a browser while it is made (docs/live.md).

Without any output named, FILE.json and FILE.png, a sheet, are written here, called like the source, unless there are
such files already. Ctrl-C and a recording that is cut leave whole files of what was done.
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

from handpose.drawing.tracks import Painter
from handpose.facts.sides import SOUGHT_SIDES
from handpose.prediction.packaged import load_predictor
from handpose.sources.first_look import FirstLook, look
from handpose.sources.recording import Recording
from handpose.track_files.track import TrackedFrame, TrackHeader
from handpose.tracking import sizing
from handpose.tracking.summary import Summary
from handpose.tracking.tracker import Tracker
from netlib.errors import DataError
from tools.common import findings, pictures
from tools.common.arguments import add_engine, parser_of, positive, positive_number
from tools.common.console import DONE, aligned, guarded, say
from tools.common.progress import ProgressBar
from tools.common.sources import add_source_options, opened, say_first_look, say_found_on_the_way, total_of
from tools.common.stopper import StoppedError, Stopper
from tools.common.track_outputs import Outputs, add_output_options, is_drawn, refuse_inputs, settle_outputs


def main(argv: list[str] | None = None) -> int:
    """Run the tool; returns the exit status."""
    parser = parser_of(__doc__, nets=True)
    add_source_options(parser)
    add_output_options(parser)
    parser.add_argument("--fit", choices=("fast", "accurate"), default="fast", help="default: %(default)s")
    parser.add_argument("--hand", choices=SOUGHT_SIDES, default="either",
                        help="which there are, where that is known (default: either, told from the depth)")  # fmt: skip
    parser.add_argument("--hands", type=positive, default=2, metavar="N", help="at most so many at once (default: 2)")
    parser.add_argument("--size", type=_size, metavar="S",
                        help="of hands, relative to the skeleton's (default: found in the first seconds)")  # fmt: skip
    parser.add_argument("--raw", action="store_true", help="do not smooth")
    parser.add_argument("--frames", type=positive, metavar="N", help="stop after so many")
    add_engine(parser)
    args = parser.parse_args(argv)
    settle_outputs(args, parser)
    return guarded(run, args)


def run(args: argparse.Namespace) -> int:
    """Track as the parsed arguments say."""
    talk = sys.stderr if args.json == "-" else sys.stdout
    with opened(args) as recording:
        refuse_inputs(args, recording)
        seen = look(recording)
        say_first_look(seen, talk)
        if args.look is not None:
            return _draw_first(args, seen)
        predictor = load_predictor(recording.camera, fit=args.fit, hand=args.hand, engine=args.engine)
        tracker = Tracker(predictor, hands=args.hands, smooth=not args.raw, size=args.size, flesh=is_drawn(args))
        summary, begun = Summary(predictor.skeleton), time.perf_counter()
        outputs, status = Outputs(args, tracker.header(recording.name), recording.rate), DONE
        try:
            with Stopper() as stopper:
                _track(recording, tracker, outputs, summary, stopper, args.frames)
        except StoppedError:
            say(f"stopped; {summary.frames} frames are kept" if summary.frames else "stopped", file=sys.stderr)
            status = 128 + stopper.signum
        say_found_on_the_way(recording, seen)
        if summary.frames:
            _say_summary(summary, time.perf_counter() - begun, outputs, talk)
        elif status == DONE:
            raise DataError(f"{recording.name}: no frames were tracked")
    return status


def _track(
    recording: Recording, tracker: Tracker, outputs: Outputs, summary: Summary, stopper: Stopper, frames: int | None
) -> None:
    """Track and write till the end of the recording, or ``frames``. Raises StoppedError, NetlibError."""
    with outputs, ProgressBar(total_of(recording, frames), what="tracking") as progress:
        outputs.begin(recording, stopper.check)
        for frame in islice(recording, frames):
            stopper.check()
            found = tracker.step(frame)
            outputs.write(frame.depth, found)
            summary.add(found)
            progress(1)


def _say_summary(summary: Summary, seconds: float, outputs: Outputs, talk: TextIO) -> None:
    """What was found, a line per hand, and where it is."""
    say(f"{summary.frames} frames of {summary.seconds:.1f} s, {summary.frames / seconds:.0f} frames/s", file=talk)
    if not summary.hands:
        say("no hand was found", file=talk)
    else:
        rows = [["hand", "frames", "sure", "size", "lost", "longest"]]
        for id, hand in sorted(summary.hands.items()):
            rows.append([f"{id} {hand.hand}", str(hand.frames), hand.sure, f"{hand.size:.3f}", str(hand.losses),
                         f"{hand.longest:.1f} s"])  # fmt: skip
        print(aligned(rows), file=talk)
    for name in outputs.written:
        say(f"wrote {name}", file=talk)


def _draw_first(args: argparse.Namespace, seen: FirstLook) -> int:
    """The first hand of the frames that were looked at; without one the first frame, which may show why."""
    predictor = load_predictor(seen.camera, fit=args.fit, hand=args.hand, engine=args.engine)
    for frame in seen.frames:
        try:
            found = predictor.in_frame(frame.depth)
        except DataError:
            continue
        findings.draw(Path(args.look), found, predictor)
        say(f"frame {frame.number}: {findings.in_words(found, predictor)}; picture {args.look}")
        return DONE
    first, header = seen.frames[0], TrackHeader(seen.name, seen.camera, predictor.skeleton)
    pictures.write_image(args.look, Painter(header).seen(first.depth, TrackedFrame(first.number, first.time, ())))
    raise DataError(f"{seen.name}: no hand in the first {len(seen.frames)} frames; {args.look} shows the first of them")


def _size(text: str) -> float:
    """Of hands, as the fit can make them."""
    try:
        return sizing.checked(positive_number(text))
    except DataError as error:
        raise argparse.ArgumentTypeError(str(error)) from None


if __name__ == "__main__":
    sys.exit(main())
