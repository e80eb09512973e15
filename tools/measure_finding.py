#!/usr/bin/env python3
"""Measure detection: synthetic scenes with forearms in front, bodies behind, and tables and bottles next to the hand.

    python tools/measure_finding.py
    python tools/measure_finding.py --scenes 30 --fit fast --json

Runs the packaged weights on full depth images of handpose.synthetic.scenes, with a seed that was not used for tuning. A
hand is "found" if its palm is within 30 mm of the true one, "right" if it is reported as a right hand, which all are;
"located" is the median distance of the locator's best candidate from the hand's centre; "mean" and "median" refer to
the error of 14 joints.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

import tools

tools.begin(__name__)

import numpy as np

from handpose import NYU, load_predictor
from handpose.scoring.metrics import mean_errors_14
from handpose.synthetic.scenes import KINDS, draw_scenes
from netlib.blob import Array
from netlib.errors import DataError
from tools.common.arguments import add_engine, count, parser_of, seed
from tools.common.console import DONE, aligned, guarded, say
from tools.common.progress import ProgressBar

FOUND_MM = 30.0


def main(argv: list[str] | None = None) -> int:
    """Run the tool; returns the exit status."""
    parser = parser_of(__doc__, nets=True)
    parser.add_argument("--scenes", type=count, default=150, metavar="N", help="default: %(default)s")
    parser.add_argument("--seed", type=seed, default=0, metavar="N", help="seed of the scenes (default: 0)")
    parser.add_argument("--fit", choices=("fast", "accurate"), default="accurate", help="default: %(default)s")
    add_engine(parser)
    parser.add_argument("--json", action="store_true", help="print JSON instead of a table")
    args = parser.parse_args(argv)
    return guarded(run, args)


def run(args: argparse.Namespace) -> int:
    """Measure detection. Raises NetlibError."""
    predictor = load_predictor(NYU, fit=args.fit, engine=args.engine, min_confidence=0)
    assert predictor.locator is not None
    palm = predictor.skeleton.joint_names.index("palm")
    rng, kinds, figures = np.random.default_rng(args.seed), [], []
    seconds = 0.0
    with ProgressBar(args.scenes) as progress:
        for number in range(args.scenes):
            scene = draw_scenes(rng, 1, first=number)
            depth, center, joints = scene.depth[0], scene.center[0], scene.joints[0]
            kinds.append(scene.kind[0])
            progress(1)
            begun = time.perf_counter()
            try:
                found = predictor.in_frame(depth)
            except DataError:  # no hand was found
                figures.append((False, False, np.nan, np.nan))
                continue
            finally:
                seconds += time.perf_counter() - begun
            located = predictor.locator.hands(depth, NYU).center[0]
            off = float(np.linalg.norm(found.xyz[palm] - joints[palm]))
            error = float(mean_errors_14(found.xyz[None], joints[None])[0])
            figures.append((off < FOUND_MM, found.hand == "right", float(np.linalg.norm(located - center)), error))
    table = np.array(figures, dtype=float)
    rows = [{"scenes": kind, **_summary(table[np.array(kinds) == kind])} for kind in KINDS if kind in kinds]
    rows.append({"scenes": "all", **_summary(table)})
    each = 1000 * seconds / args.scenes
    if args.json:
        print(json.dumps({"seed": args.seed, "fit": args.fit, "ms": each, "rows": rows}, indent=2))
    else:
        say(f"{args.scenes} scenes, seed {args.seed}, {args.fit} fit, {each:.0f} ms each; mm")
        cells = [
            [row["scenes"], row["count"], f"{row['found']:.1%}", f"{row['right']:.1%}",
             *("" if row[name] is None else f"{row[name]:.1f}" for name in ("located", "mean", "median"))]
            for row in rows
        ]
        print(aligned([list(rows[0]), *([str(cell) for cell in row] for row in cells)]))
    return DONE


def _summary(table: Array) -> dict[str, float | None]:
    """Summarize scenes (n, 4): fractions found and reported as right hands, mean and median errors of those found."""
    found, right, located, error = table.T
    answered = ~np.isnan(error)
    answers = (
        (np.median(located[answered]), error[answered].mean(), np.median(error[answered]))
        if answered.any()
        else (None,) * 3
    )
    return {
        "count": len(table),
        "found": float(found.mean()),
        "right": float(right.mean()),
        **{
            name: None if value is None else float(value) for name, value in zip(("located", "mean", "median"), answers)
        },
    }


if __name__ == "__main__":
    sys.exit(main())
