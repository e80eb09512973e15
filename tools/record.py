#!/usr/bin/env python3
"""Record a depth camera, or convert a recording to a format that can be replayed.

    python tools/record.py realsense --out takes/wave --seconds 20
    python tools/record.py take.bag --out take.npz
    python tools/record.py "frames/left_*.png" --camera sr305 --rate 60 --out left.npz

SOURCE is a folder with a 16-bit PNG, .npy, .npz or .raw for each frame or a quoted pattern of their
names, an array file (.npy, .npz), a ROS bag, or realsense, a connected camera. --out is a folder of
16-bit PNG, named by their times, with a camera.json, or FILE.npz. The output is undistorted.

Ctrl-C ends a recording and keeps it. Nothing is overwritten.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

import tools

tools.begin(__name__)

from handpose import RecordingWriter
from handpose.frames.inspection import Inspection, inspect
from netlib.errors import NetlibError
from tools.common import arguments, outputs
from tools.common.console import DONE, guarded, notify, say
from tools.common.progress import ProgressBar, StoppedError, Stopper
from tools.common.sources import add_source_options, opened, print_inspection, print_new_remarks

MAX_UNIT_MM = 1.0  # of the output; depths of sources in metres have fractions


def main(argv: list[str] | None = None) -> int:
    """Run the tool; returns the exit status."""
    parser = arguments.parser_of(__doc__)
    add_source_options(parser)
    parser.add_argument(
        "--out", required=True, metavar="FOLDER|FILE.npz", type=Path, help="output, new"
    )
    parser.add_argument("--seconds", type=arguments.seconds, metavar="S", help="maximum duration")
    return guarded(run, parser.parse_args(argv))


def run(args: argparse.Namespace) -> int:
    """Write the recording."""
    source = Path(args.source).absolute()
    outputs.refuse_inputs(args.out, [source, source.parent], "contains the source")
    with opened(args) as recording:
        unit_mm = min(recording.unit_mm, MAX_UNIT_MM)
        writer = RecordingWriter(args.out, recording.camera, unit_mm, recording.rate)
        inspection = inspect(recording)
        print_inspection(inspection)
        try:
            with Stopper() as stopper:
                seconds = _write(inspection, writer, stopper, args.seconds)
        except StoppedError:
            notify(f"stopped; {args.out} has {writer.count} frames")
            return 128 + stopper.signum
        except NetlibError as error:
            kept = f"; {args.out} has the {writer.count} frames before it" if writer.count else ""
            raise NetlibError(f"{error}{kept}") from None
        print_new_remarks(inspection)
    if not writer.count:
        raise NetlibError(f"{args.source}: no frames")
    say(f"wrote {args.out}: {writer.count} frames of {seconds:.1f} s, unit {unit_mm:g} mm")
    return DONE


def _write(
    inspection: Inspection, writer: RecordingWriter, stopper: Stopper, limit: float | None
) -> float:
    """Write the frames of at most ``limit`` seconds; returns the time in s from the first to the
    last.

    Raises StoppedError.
    """
    first = last = None
    count = inspection.recording.count or 0
    with writer, ProgressBar(count, what="recording") as progress:
        for frame in inspection.all_frames():
            stopper.check()
            first = frame.time if first is None else first
            if limit is not None and frame.time - first >= limit:
                break
            writer.write(frame)
            last = frame.time
            progress(1)
    return 0.0 if first is None or last is None else last - first


if __name__ == "__main__":
    sys.exit(main())
