#!/usr/bin/env python3
"""Generate a synthetic depth recording of moving hands with ground truth, for testing trackers.

    python tools/make_recording.py minute --out takes/minute
    python tools/make_recording.py moving --camera kinect2 --hand left \\
        --rate 60 --seconds 10 --seed 3 --out left.npz

SCRIPT is one of
    rest       a hand at rest, so that all changes are noise
    gestures   a hand shows named gestures, and waves
    moving     a hand moves freely through poses of the prior, with pauses
    leaves     a hand leaves the image and returns, twice
    two_hands  both hands of one person
    left       a left hand
    body       a person is visible behind the hand
    minute     all of these

--out is a folder of 16-bit PNG or FILE.npz, as written by tools/record.py. The ground truth is a
track in OUT.truth.json, as written by tools/track.py. Frames where it reports a hand as lost
because it is "partly in sight" have no correct answer for a tracker. The seed determines
everything; noise is that of the camera.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

import tools

tools.begin(__name__)

from handpose import CAMERAS, NYU, RecordingWriter
from handpose.body.sides import SIDES
from handpose.output.tracks.writing import open_writer
from handpose.sequences.recordings import SCRIPTS, SyntheticRecording
from netlib.errors import NetlibError
from netlib.files import make_folder
from netlib.files.paths import exists
from tools.common.arguments import parser_of, seconds, seed
from tools.common.console import DONE, guarded, notify, say
from tools.common.progress import ProgressBar, StoppedError, Stopper
from tools.common.sources import camera, rate


def main(argv: list[str] | None = None) -> int:
    """Run the tool; returns the exit status."""
    parser = parser_of(__doc__)
    parser.add_argument("script", metavar="SCRIPT", choices=SCRIPTS, help=", ".join(SCRIPTS))
    parser.add_argument(
        "--out", required=True, metavar="FOLDER|FILE.npz", type=Path, help="output, new"
    )
    parser.add_argument(
        "--camera",
        type=camera,
        default=NYU,
        metavar="NAME|FX,FY,U0,V0",
        help=f"{', '.join(CAMERAS)}, or four numbers in px (default: {NYU.name})",
    )
    parser.add_argument(
        "--rate",
        type=rate,
        default=30.0,
        metavar="HZ",
        help="frames per second (default: %(default)g)",
    )
    parser.add_argument(
        "--seconds", type=seconds, metavar="S", help="duration (default: that of the script)"
    )
    parser.add_argument(
        "--hand", choices=SIDES, help="side of the first hand; a second one is the other"
    )
    parser.add_argument(
        "--clean", action="store_true", help="without noise and other artefacts of a camera"
    )
    parser.add_argument(
        "--seed", type=seed, default=0, metavar="N", help="random seed (default: %(default)s)"
    )
    return guarded(run, parser.parse_args(argv))


def run(args: argparse.Namespace) -> int:
    """Generate the recording."""
    if not args.out.name:
        raise NetlibError(f"{args.out}: expected the name of a new folder or FILE.npz")
    name = args.out.stem if args.out.suffix == ".npz" else args.out.name
    truth = args.out.with_name(f"{name}.truth.json")
    if truth.exists():
        raise NetlibError(f"{truth}: is there already; choose another --out or remove it")
    first_side = next(iter(SCRIPTS[args.script].acts))
    recording = SyntheticRecording(
        args.script,
        args.camera,
        rate=args.rate,
        seconds=args.seconds,
        seed=args.seed,
        clean=args.clean,
        mirrored=args.hand not in (None, first_side),
    )
    writer = RecordingWriter(args.out, recording.camera, recording.unit_mm, recording.rate)
    make_folder(truth.parent)
    try:
        with (
            Stopper() as stopper,
            open_writer(truth, recording.header) as track,
            writer,
            ProgressBar(recording.count, what="recording") as progress,
        ):
            for frame in recording:
                stopper.check()
                writer.write(frame)
                track.write(recording.truth(frame.number))
                progress(1)
    except StoppedError:
        notify(f"stopped; {args.out} and {truth} have {writer.count} frames")
        return 128 + stopper.signum
    except BaseException:
        if exists(truth) and not exists(args.out):  # no ground truth without its recording
            truth.unlink()
        raise
    duration = writer.count / recording.rate
    say(
        f"wrote {args.out}: {writer.count} frames of {duration:.1f} s, "
        f"unit {recording.unit_mm:g} mm; ground truth in {truth}"
    )
    return DONE


if __name__ == "__main__":
    sys.exit(main())
