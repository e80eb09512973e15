#!/usr/bin/env python3
"""Score snapshots on the test set of a net: its outputs, joint errors in mm, success rates,
violated limits.

    python tools/test.py snapshots/nyu_iter_*.caffemodel.h5

    python tools/test.py snapshots/person_iter_20000.caffemodel.h5 \\
        --model prototxt/body/person_train_test.prototxt

    python tools/test.py --joints ...           # also the error per joint of the last snapshot

    python tools/test.py --fit accurate ...     # also the same after a fit of the hand
                                                model to the depth

Errors are distances between predicted and annotated joints, relative to the centre of the crop
(joint 34 of the NYU annotation; the same point in synthetic data) and scaled by the cube of each
frame. The success rate is the fraction of frames in which all joints (for NYU's hand: the 14
evaluation joints) are within 20 or 40 mm; thresholds of larger bodies are scaled by their cube.
"""

from __future__ import annotations

import argparse
import json
import re
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

import tools

tools.begin(__name__)

import numpy as np

import netlib
from handpose.datasets.frames import spread
from handpose.estimate.nets import hand_layer
from handpose.fit.settings import PLANS, FitSettings
from handpose.output.drawing import hands
from handpose.scoring import held_out
from handpose.scoring.held_out import data_layer, errors_by_joint, figures_of
from layers.hand import skeleton as skeletons
from netlib.blob import Array
from netlib.errors import WeightsError
from netlib.files.paths import ROOT
from netlib.net import Net
from tools.common import outputs
from tools.common.arguments import add_engine, name_in, parser_of, reject_given
from tools.common.console import aligned, guarded, notify, say
from tools.common.costs import warn_of_another_net
from tools.common.progress import ProgressBar

SAME = 1e-6  # half-cubes; predictions for different frames differ by more
DRAWN = 12  # frames in a figure
COLUMNS = {  # figure -> heading, format
    "error_mm": ("all joints mm", "{:.2f}"),
    "error_14_mm": ("14 joints mm", "{:.2f}"),
    "out_of_limits": ("out of limits", "{:.1%}"),
    "fit_error_mm": ("fit: all joints mm", "{:.2f}"),
    "fit_error_14_mm": ("14 joints mm", "{:.2f}"),
}
MODEL, DEPLOY = (ROOT / "prototxt" / f"nyu_{kind}.prototxt" for kind in ("train_test", "deploy"))
WITHIN = re.compile(r"(?:fit_)?within_(\d+)_mm")


def main(argv: list[str] | None = None) -> int:
    """Run the tool; returns the exit status."""
    parser = parser_of(__doc__, nets=True)
    parser.add_argument("snapshots", metavar="SNAPSHOT", nargs="+", help="weights, *.caffemodel.h5")
    parser.add_argument(
        "--model",
        metavar="NET",
        default=str(MODEL),
        help=f"the net's prototxt, also if only its skeleton was changed (default: {MODEL.name})",
    )
    parser.add_argument("--fit", choices=PLANS, help="also fit the predicted hands to the depth")
    parser.add_argument(
        "--deploy",
        metavar="NET",
        default=str(DEPLOY),
        help=f"with --fit: deploy prototxt of the net (default: {DEPLOY.name})",
    )
    parser.add_argument(
        "--picture",
        metavar="FILE.png",
        type=name_in(".png"),
        help=f"draw {DRAWN} frames with predictions of the last snapshot",
    )
    parser.add_argument(
        "--joints", action="store_true", help="print the error per joint of the last snapshot"
    )
    add_engine(parser)
    parser.add_argument("--json", action="store_true", help="print JSON instead of a table")
    args = parser.parse_args(argv)
    if not args.fit:
        reject_given(parser, args, ["deploy"], "applies only with --fit")
    return guarded(run, args)


def run(args: argparse.Namespace) -> None:
    """Score the snapshots."""
    rows = []
    net = Net(args.model, netlib.TEST, engine=args.engine)
    hand = hand_layer(net)
    skeleton = hand.skeleton if hand else skeletons.load()
    for snapshot in args.snapshots:
        predictions = _predict(net, snapshot)
        row = {"snapshot": snapshot, **predictions.outputs, **figures_of(predictions, skeleton)}
        if args.fit:
            joints = _fit(net, snapshot, args)
            predictions = replace(predictions, joints=joints, skeleton=joints, dof=None)
            figures = figures_of(predictions, skeleton)
            row |= {f"fit_{name}": value for name, value in figures.items()}
        rows.append(row)
    if args.picture:
        _draw(Path(args.picture), net, predictions)
    by_joint = errors_by_joint(predictions, skeleton) if args.joints else {}
    if args.json:
        print(_json(args.model, predictions, rows, by_joint))
        return
    cubes = sorted(set((2 * predictions.half_cube).round(1).tolist()))
    say(
        f"{len(predictions.joints)} frames ({predictions.made_from}), errors about the crop's centre, "
        f"cube {', '.join(f'{c:g}' for c in cubes[:3])} mm"
    )
    print(_table(rows))
    for name, mm in by_joint.items():
        print(f"  {name:<16}{mm:7.1f} mm")


def _predict(net: Net, snapshot: str) -> held_out.Predictions:
    """Predict the test set with the weights of a snapshot.

    Raises NetlibError, and prints a warning if all predictions are equal.
    """
    warn_of_another_net(snapshot, net)
    try:
        net.copy_from(snapshot, strict=True)
    except WeightsError as error:
        raise WeightsError(
            f"{error}; the net is {net.source}: give that of these weights with --model"
        ) from error
    with ProgressBar(data_layer(net).rows, what=Path(snapshot).name) as progress:
        predictions = held_out.predict_all(net, progress=progress.reach)
    count = len(predictions.joints)
    if count > 1 and np.ptp(predictions.joints, axis=0).max() < SAME:
        notify(
            f"warning: {snapshot}: all {count} predictions are equal, whatever the frame shows: "
            "are units of a layer dead? A lower base_lr may help"
        )
    return predictions


def _fit(net: Net, snapshot: str, args: argparse.Namespace) -> Array:
    """Joints (N, K, 3) in half-cubes of the test set, predicted and fitted to the depth.

    Raises NetlibError.
    """
    deploy = held_out.deploy_of(net, args.deploy, snapshot, args.engine)
    plan = FitSettings().search.plans[args.fit]
    name = f"{Path(snapshot).name} {args.fit}"
    with ProgressBar(data_layer(net).rows, what=name) as progress:
        return held_out.fit_all(net, deploy, snapshot, plan, progress.reach)


def _json(
    model: str, found: held_out.Predictions, rows: list[dict[str, Any]], by_joint: dict[str, float]
) -> str:
    """The figures of the snapshots, and the errors of the joints of the last one if any."""
    facts = {
        "model": model,
        "frames": len(found.joints),
        "data": found.made_from,
        "centre": "of the crop",
        "snapshots": rows,
    }
    if by_joint:
        facts["joints_mm"] = by_joint
    return json.dumps(facts, indent=2, allow_nan=False)


def _draw(path: Path, net: Net, found: held_out.Predictions) -> None:
    """Draw evenly spaced test frames, on the crop and in 3-D: predictions in colour, annotations
    as thin lines.
    """
    hand = hand_layer(net)
    chosen = spread(len(found.joints), DRAWN)
    sheet = hands.two_views(
        held_out.crops_of(net, chosen),
        (found.joints if found.skeleton is None else found.skeleton)[chosen],
        found.truth[chosen],
        hand.skeleton if hand else skeletons.load(),
        [
            (f"frame {i}", f"{error:.0f} mm")
            for i, error in zip(chosen, found.errors_mm[chosen].mean(axis=1))
        ],
        *held_out.centers_of(net, chosen),
        (2 * found.half_cube[chosen]).tolist(),
    )
    path.parent.mkdir(parents=True, exist_ok=True)
    outputs.write_image(path, sheet)
    notify(f"wrote {path}")


def _table(rows: list[dict[str, object]]) -> str:
    """Format a table with one line per snapshot."""
    names = [name for name in rows[0] if name != "snapshot"]
    cells = ([str(row["snapshot"]), *(_column(n)[1].format(row[n]) for n in names)] for row in rows)
    return aligned([["snapshot", *(_column(n)[0] for n in names)], *cells])


def _column(name: str) -> tuple[str, str]:
    """Heading and format of a column."""
    if within := WITHIN.fullmatch(name):
        return f"max <= {within[1]} mm", "{:.1%}"
    return COLUMNS.get(name, (name, "{:.5g}"))


if __name__ == "__main__":
    sys.exit(main())
