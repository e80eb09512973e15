#!/usr/bin/env python3
"""Measure gesture recognition: a confusion table over synthetic recordings of one hand.

    python tools/measure_gestures.py --seeds 100 101 102 103
    python tools/measure_gestures.py --seeds 100 --seconds 5 --cameras kinect2 --truth

Each recording shows the gestures in random order, each held for 0.4 to 1.2 s. Rows are the gestures shown, columns
those recognized, in percent of the frames in which the fingers have been at rest for 0.2 s; "none" means no gesture,
"lost" no hand. --truth recognizes gestures from the true joints instead of a tracker's.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Iterable
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

import tools

tools.begin(__name__)

import numpy as np

from experiments.gesture_figures import READ, measure
from handpose import CAMERAS, Tracker, load_predictor
from handpose.body.gestures.shapes import GESTURES
from handpose.sequences.recordings import SyntheticRecording
from handpose.sequences.scripts import SHOWING
from handpose.tracking.track import TrackedFrame, TrackHeader
from tools.common.arguments import add_engine, parser_of, seconds, seed
from tools.common.console import DONE, aligned, guarded, say


def main(argv: list[str] | None = None) -> int:
    """Run the tool; returns the exit status."""
    parser = parser_of(__doc__, nets=True)
    parser.add_argument("--seeds", type=seed, nargs="+", default=[100], metavar="N",
                        help="seeds of the recordings (default: 100)")
    parser.add_argument("--cameras", choices=CAMERAS, nargs="+", default=["nyu"], metavar="NAME",
                        help=f"some of {', '.join(CAMERAS)} (default: nyu)")
    parser.add_argument("--seconds", type=seconds, metavar="S", help="duration of each (default: 30)")
    parser.add_argument("--truth", action="store_true", help="use the true joints instead of a tracker")
    parser.add_argument("--left", action="store_true", help="use the left hand")
    add_engine(parser)
    parser.add_argument("--json", action="store_true", help="print JSON instead of a table")
    return guarded(run, parser.parse_args(argv))


def run(args: argparse.Namespace) -> int:
    """Measure gesture recognition. Raises NetlibError."""
    recordings = [SyntheticRecording(SHOWING, CAMERAS[camera], seconds=args.seconds, seed=seed, mirrored=args.left)
                  for camera in args.cameras for seed in args.seeds]

    def tracked(recording: SyntheticRecording) -> tuple[TrackHeader, Iterable[TrackedFrame]]:
        if args.truth:
            return recording.header, recording.truths()
        tracker = Tracker(load_predictor(recording.camera, fit="fast", hand="either", engine=args.engine), hands=1,
                          min_confidence=0)
        return tracker.header(recording.name), map(tracker.step, recording)

    found = measure(recordings, tracked)
    delay = float(np.median(found.delays)) if found.delays else None
    if args.json:
        counts = {name: dict(zip(READ, row.tolist())) for name, row in zip(GESTURES, found.counts)}
        right = None if np.isnan(found.right()) else round(found.right(), 4)
        print(json.dumps({"frames": counts, "right": right, "delay_s": delay}, indent=2))
        return DONE
    rows = [["shown", "frames", *READ]]
    for name, row in zip(GESTURES, found.counts):
        rows.append([name, str(row.sum()), *(f"{100 * n / row.sum():.0f}" if n else "" for n in row)])
    print(aligned(rows))
    say(f"{found.right():.1%} of {found.counts.sum()} frames are recognized correctly; "
        f"median delay {delay or 0:.2f} s after the fingers come to rest, {len(found.delays)} times")
    return DONE


if __name__ == "__main__":
    sys.exit(main())
