#!/usr/bin/env python3
"""Measure the tracker on synthetic recordings: errors, missed and invented hands, handedness, jitter, lag, speed.

    python tools/measure_tracking.py
    python tools/measure_tracking.py --scripts minute two_hands --cameras nyu kinect2 --seeds 0 1 --frame-by-frame
    python tools/measure_tracking.py --scripts moving --rate 60 --seconds 5 --raw --fit accurate --json

The scripts are those of tools/make_recording.py. There is a row for each of their hands, and one for all. Joint errors
are in mm, over frames in which the hand is visible and "found", that is, reported with a mean error of at most 100 mm;
"mean 14" and "median 14" are for NYU's 14 joints. In other frames with a visible hand it is "missed"; "invented" counts
reported hands where there is none. "ids" and "flips" count changes of its id and of its reported side; "wrong side"
counts frames in which that is wrong. "jitter" is in mm while the hand rests, "lag" in ms while it moves, "bone" is the
largest change of a bone length in mm. "frames/s" is the speed of the tracker without rendering.

--frame-by-frame also fits each frame independently with the same plan, without history, but given the true centre of
the crop and side. "same" and "alone" are the mean errors of the track and of these fits in frames in which both find
the hand, "same md" and "alone md" the medians; "found alone" is the fraction of visible hands that the fits find.
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

import tools

tools.begin(__name__)

from experiments.tracking_figures import Alone, HandFigures, Tracked, follow, summary
from handpose import CAMERAS, Camera, Tracker, load_predictor
from handpose.body.sides import SIDES
from handpose.sequences.recordings import SyntheticRecording
from handpose.sequences.scripts import SCRIPTS
from tools.common.arguments import add_engine, count, parser_of, seconds, seed
from tools.common.console import DONE, aligned, guarded, say
from tools.common.progress import ProgressBar
from tools.common.sources import rate

Row = dict[str, str | float | None]
TITLES = {  # columns: key -> title and format
    "in_sight": ("in sight", "d"), "found": ("found", ".1%"), "mean": ("mean", ".1f"), "median": ("median", ".1f"),
    "mean_14": ("mean 14", ".1f"), "median_14": ("median 14", ".1f"), "same": ("same", ".1f"),
    "alone": ("alone", ".1f"), "same_median": ("same md", ".1f"), "alone_median": ("alone md", ".1f"),
    "alone_found": ("found alone", ".1%"), "missed": ("missed", "d"), "invented": ("invented", "d"),
    "id_switches": ("ids", "d"), "wrong_side": ("wrong side", "d"), "side_switches": ("flips", "d"),
    "jitter": ("jitter", ".2f"), "lag": ("lag", ".0f"), "bone_change": ("bone", ".2f"), "rate": ("frames/s", ".0f"),
}


def main(argv: list[str] | None = None) -> int:
    """Run the tool; returns the exit status."""
    parser = parser_of(__doc__, nets=True)
    parser.add_argument("--scripts", choices=SCRIPTS, nargs="+", default=list(SCRIPTS), metavar="NAME",
                        help=f"some of {', '.join(SCRIPTS)} (default: all)")
    parser.add_argument("--cameras", choices=CAMERAS, nargs="+", default=["nyu"], metavar="NAME",
                        help=f"some of {', '.join(CAMERAS)} (default: nyu)")
    parser.add_argument("--seeds", type=seed, nargs="+", default=[0], metavar="N",
                        help="seeds of the recordings (default: 0)")
    parser.add_argument("--rate", type=rate, default=30.0, metavar="HZ",
                        help="frames per second (default: %(default)g)")
    parser.add_argument("--seconds", type=seconds, metavar="S", help="duration (default: the script's)")
    parser.add_argument("--fit", choices=("fast", "accurate"), default="fast", help="default: %(default)s")
    parser.add_argument("--raw", action="store_true", help="do not smooth")
    parser.add_argument("--frame-by-frame", type=count, nargs="?", const=1, metavar="N",
                        help="also fit each frame, or every N-th, independently")
    add_engine(parser)
    parser.add_argument("--json", action="store_true", help="print JSON instead of a table")
    return guarded(run, parser.parse_args(argv))


def run(args: argparse.Namespace) -> int:
    """Measure the tracker. Raises NetlibError."""
    recordings = [
        (script, camera, seed, SyntheticRecording(script, CAMERAS[camera], rate=args.rate, seconds=args.seconds,
                                                  seed=seed))
        for camera in args.cameras for script in args.scripts for seed in args.seeds
    ]
    rows: list[Row] = []
    hands: list[HandFigures] = []
    invented, frames, seconds = 0, 0, 0.0
    with ProgressBar(sum(recording.count for *_, recording in recordings), what="tracking") as progress:
        for script, camera, seed, recording in recordings:
            tracker = Tracker(load_predictor(recording.camera, fit=args.fit, engine=args.engine), smooth=not args.raw,
                              min_confidence=0)
            alone = _alone(recording.camera, args) if args.frame_by_frame else None
            tracked = follow(recording, tracker, alone, args.frame_by_frame or 1, progress)
            rows += _rows({"script": script, "camera": camera, "seed": str(seed)}, tracked)
            hands += tracked.hands
            invented, frames, seconds = invented + tracked.invented, frames + tracked.frames, seconds + tracked.seconds
    total: Row = {**summary(hands), "invented": invented, "rate": frames / seconds}
    rows.append({"script": "all", "camera": "", "seed": "", "hand": "", **total})
    if args.json:
        facts = {"fit": args.fit, "hz": args.rate, "smoothed": not args.raw, "frames": frames}
        print(json.dumps({**facts, "rows": rows}, indent=2))
    else:
        how = "not smoothed" if args.raw else "smoothed"
        say(f"{frames} frames, {args.rate:g} per second, {args.fit} fit, {how}; mm, lag in ms")
        print(_table(rows))
    return DONE


def _alone(camera: Camera, args: argparse.Namespace) -> Alone:
    """The independent fits of a camera's frames, with the tracker's plan."""
    right, left = (load_predictor(camera, hand=side, refine=0, fit=args.fit, engine=args.engine, min_confidence=0)
                   for side in SIDES)
    return Alone(right, left)


def _rows(names: dict[str, str], tracked: Tracked) -> list[Row]:
    """One row per hand of a recording; values of the whole recording are in the first row."""
    rows: list[Row] = [
        {**names, "hand": f"{hand.scores.id} {hand.scores.hand}", **summary([hand])} for hand in tracked.hands
    ] or [{**names, "hand": "none", **summary([])}]
    rows[0] |= {"invented": tracked.invented, "rate": tracked.frames / tracked.seconds}
    return rows


def _table(rows: list[Row]) -> str:
    """Format the rows without empty columns."""
    filled = {name for row in rows for name, value in row.items() if value is not None}
    names = ["script", "camera", "seed", "hand", *(name for name in TITLES if name in filled)]

    def cell(row: Row, name: str) -> str:
        value = row.get(name)
        return value if isinstance(value, str) else "" if value is None else format(value, TITLES[name][1])

    return aligned([[TITLES.get(name, (name,))[0] for name in names], *([cell(row, n) for n in names] for row in rows)])


if __name__ == "__main__":
    sys.exit(main())
