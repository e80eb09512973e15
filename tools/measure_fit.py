#!/usr/bin/env python3
"""Measure a network and the fit after it on synthetic hands: errors, failures, confidence, handedness.

    python tools/measure_fit.py
    python tools/measure_fit.py --weights snapshots/x.caffemodel.h5 --model prototxt/nyu_deploy.prototxt
    python tools/measure_fit.py --recipes nyu other_flesh --frames 512 --terms

The default is the packaged network on all recipes; --terms omits each term of the fit in turn.

Frames are drawn from recipes (listed by tools/make_synthetic.py --help) with a split and seed that were not used for
tuning. Errors are means over NYU's 14 joints in mm. A frame has failed if its error is above 30 mm; "auc" measures how
well the uncertainty predicts failures; "expected" is the mean error that the fit predicts. "right" is the fraction of
frames with less uncertainty than their mirror image (--hands). --roll groups errors by the rotation of the palm in the
image.
"""

from __future__ import annotations

import argparse
import functools
import json
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

import tools

tools.begin(__name__)

import numpy as np

from experiments.fit_figures import Figures, auc, frames_of, measure
from handpose.estimate.nets import refuse_other_bodies, skeleton_to_fit, trained
from handpose.estimate.packaged import SYNTHETIC_HAND, checked_weights, read_card
from handpose.fit.depth_fit import DepthFitter
from handpose.fit.network_errors import GOOD_MM
from handpose.fit.objective import Weights
from handpose.fit.search import PLANS
from handpose.synthetic import recipes
from handpose.synthetic.generator import Generator
from netlib.blob import Array
from tools.common.arguments import add_engine, count, parser_of, seed
from tools.common.console import DONE, aligned, guarded, say
from tools.common.progress import ProgressBar

TERMS = {  # omitted term -> weights
    "nothing": Weights(),
    "silhouette": replace(Weights(), outline=0.0),
    "free space": replace(Weights(), front=0.0),
    "both": replace(Weights(), outline=0.0, front=0.0),
    "limbs' prior": replace(Weights(), limbs=0.05),
    "natural poses": replace(Weights(), poses=0.0),
    "less forearm": replace(Weights(), beyond=1.0),
    "palm's prior": replace(Weights(), rigid=140.0),
    "size": replace(Weights(), size=0.0),
    "thickness": replace(Weights(), thickness=1e-3),
}
ROLLS = ((-180, -135), (-135, -45), (-45, 45), (45, 135), (135, 180))


def main(argv: list[str] | None = None) -> int:
    """Run the tool; returns the exit status."""
    parser = parser_of(__doc__, nets=True)
    parser.add_argument("--weights", metavar="FILE", help="*.caffemodel.h5 (default: those of models/synthetic_hand)")
    parser.add_argument("--model", metavar="NET", help="deploy prototxt of their net")
    parser.add_argument("--recipes", choices=recipes.NAMES, nargs="+", default=list(recipes.NAMES[:4]), metavar="NAME",
                        help=f"some of {', '.join(recipes.NAMES)} (default: the first four)")
    parser.add_argument("--plans", choices=PLANS, nargs="+", default=list(PLANS), metavar="PLAN",
                        help=f"some of {', '.join(PLANS)} (default: all)")
    parser.add_argument("--frames", type=count, default=2000, metavar="N", help="default: %(default)s")
    parser.add_argument("--seed", type=seed, default=0, metavar="N",
                        help="seed of the test frames (default: 0)")
    parser.add_argument("--hands", action="store_true", help="also fit mirror images (twice the time)")
    parser.add_argument("--roll", action="store_true", help="errors by rotation of the palm in the image")
    parser.add_argument("--terms", action="store_true", help="errors without each term of the fit")
    add_engine(parser)
    parser.add_argument("--json", action="store_true", help="print JSON instead of a table")
    args = parser.parse_args(argv)
    if bool(args.weights) != bool(args.model):
        parser.error("--weights and --model must be given together")
    return guarded(run, args)


def run(args: argparse.Namespace) -> int:
    """Measure the network and the fits. Raises NetlibError."""
    weights = Path(args.weights) if args.weights else checked_weights(read_card(SYNTHETIC_HAND))
    net = trained(args.model or SYNTHETIC_HAND / "deploy.prototxt", weights, args.engine)
    refuse_other_bodies(skeleton_to_fit(net), "the recipes are of hands")
    skeleton = skeleton_to_fit(net)
    terms = TERMS if args.terms else {"nothing": Weights()}
    plans = [PLANS[name] for name in args.plans]
    rows: list[dict[str, Any]] = []
    begun = time.perf_counter()
    with ProgressBar(args.frames * len(args.recipes) * len(terms)) as progress:
        for recipe in args.recipes:
            for without, own in terms.items():
                generator = Generator(args.seed, "test", recipes.recipe(recipe))
                found = measure(net, functools.partial(DepthFitter.of_file, skeleton, weights, weights=own),
                                frames_of(generator, args.frames), plans, hands=args.hands,
                                progress=progress)
                rows += _rows(recipe, found, without if args.terms else "", args.roll)
    if args.json:
        print(json.dumps({"weights": str(weights), "frames": args.frames, "seed": args.seed, "rows": rows}, indent=2))
    else:
        say(f"{args.frames} frames per recipe, seed {args.seed}, {time.perf_counter() - begun:.0f} s; mm, 14 joints")
        print(_table(rows))
    return DONE


def _rows(recipe: str, found: Figures, without: str, by_roll: bool) -> list[dict[str, Any]]:
    """One row for the network and one per plan; optionally the same for each range of the roll."""
    every = np.ones(len(found.network), bool)
    groups = [("", every)]
    if by_roll:
        groups += [(f"{low} to {high}", (found.roll >= low) & (found.roll < high)) for low, high in ROLLS]
    rows = []
    for roll, chosen in groups:
        if not chosen.any():
            continue
        facts = {"recipe": recipe, **({"without": without} if without else {}), **({"roll": roll} if by_roll else {})}
        rows.append({**facts, "plan": "network", **_errors(found.network[chosen])})
        for plan, errors in found.fits.items():
            row = {**facts, "plan": plan, **_errors(errors[chosen])}
            row["auc"] = auc(found.uncertainty[plan][chosen], errors[chosen] > GOOD_MM)
            row["expected"] = float(found.expected[plan][chosen].mean())
            row["confidence"] = float(found.confidence[plan][chosen].mean())
            if plan in found.right:
                row["right"] = float(found.right[plan][chosen].mean())
            rows.append({name: None if isinstance(v, float) and np.isnan(v) else v for name, v in row.items()})
    return rows


def _errors(errors: Array) -> dict[str, float]:
    return {
        "frames": len(errors),
        "mean": float(errors.mean()),
        "median": float(np.median(errors)),
        "failed": float((errors > GOOD_MM).mean()),
    }


def _table(rows: list[dict[str, Any]]) -> str:
    names = list(dict.fromkeys(name for row in rows for name in row))
    formats = {"mean": "{:.2f}", "median": "{:.2f}", "failed": "{:.1%}", "auc": "{:.3f}", "expected": "{:.2f}",
               "confidence": "{:.1%}", "right": "{:.1%}"}

    def cell(row: dict[str, Any], name: str) -> str:
        value = row.get(name)
        return "" if value is None else formats.get(name, "{}").format(value)

    return aligned([names, *([cell(row, name) for name in names] for row in rows)])


if __name__ == "__main__":
    sys.exit(main())
