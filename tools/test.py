#!/usr/bin/env python3
"""Score snapshots on the test set of a net: its outputs, joint errors in mm, success rates, broken limits.

    python tools/test.py snapshots/nyu_iter_*.caffemodel.h5

Errors are between predicted and annotated joints, both relative to the centre of the crop (joint 34 of the NYU
annotation; on synthetic data the same place of the synthetic hand) and scaled by each frame's own cube.
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

import netlib  # before NumPy: it chooses BLAS kernels

# isort: split

import numpy as np

from handpose.drawing import hands, sheets
from handpose.predicting.nets import data_layer, hand_layer
from handpose.scoring.held_out import Predictions, figures_of, predict_all
from handpose.scoring.metrics import joint_errors
from layers.hand import skeleton as skeletons
from netlib.net import Net
from tools import pictures
from tools.console import DONE, aligned, guarded, progress_bar
from tools.train import with_advice

ROOT = Path(__file__).resolve().parent.parent
COLUMNS = {  # figure -> heading, format
    "error_mm": ("all joints mm", "{:.2f}"),
    "error_14_mm": ("14 joints mm", "{:.2f}"),
    "within_20_mm": ("max <= 20 mm", "{:.1%}"),
    "within_40_mm": ("max <= 40 mm", "{:.1%}"),
    "out_of_limits": ("out of limits", "{:.1%}"),
}


def main(argv: list[str] | None = None) -> int:
    """Run the tool; returns the exit status."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("snapshots", metavar="SNAPSHOT", nargs="+", help="weights, *.caffemodel.h5")
    parser.add_argument(
        "--model",
        metavar="NET",
        default=str(ROOT / "prototxt" / "nyu_train_test.prototxt"),
        help="default: nyu_train_test.prototxt",
    )
    parser.add_argument("--picture", metavar="FILE", help="draw the first frames with the last snapshot's hands")
    parser.add_argument("--json", action="store_true", help="print JSON instead of a table")
    args = parser.parse_args(argv)
    if args.picture and not args.picture.lower().endswith(".png"):
        parser.error(f"--picture must end in .png, found {args.picture}")
    return guarded(lambda: run(args))


def run(args: argparse.Namespace) -> int:
    """Score as the parsed arguments say."""
    rows = []
    with with_advice():
        net = Net(args.model, netlib.TEST)
    for snapshot in args.snapshots:
        net.copy_from(snapshot, strict=True)
        predictions = _run(net, snapshot)
        hand = hand_layer(net)
        figures = figures_of(predictions, hand.skeleton if hand else skeletons.load())
        rows.append({"snapshot": snapshot, **predictions.outputs, **figures})
    if args.picture:
        write_picture(args.picture, net, predictions)
    if args.json:
        facts = {"model": args.model, "frames": len(predictions.joints), "data": predictions.made_from}
        print(json.dumps({**facts, "centre": "of the crop", "snapshots": rows}, indent=2, allow_nan=False))
    else:
        cubes = sorted(set((2 * predictions.half_cube).round(1).tolist()))
        print(f"{len(predictions.joints)} frames ({predictions.made_from}), errors about the crop's centre, "
              f"cube {', '.join(f'{c:g}' for c in cubes[:3])} mm")  # fmt: skip
        print(_table(rows))
    return DONE


def _run(net: Net, snapshot: str) -> Predictions:
    bar = progress_bar(data_layer(net).rows, 0, "frame")
    if bar is None:
        return predict_all(net)
    with bar:
        bar.set_description(Path(snapshot).name)
        return predict_all(net, progress=lambda done: bar.update(done - bar.n))


def write_picture(path: str, net: Net, predictions: Predictions, count: int = 12) -> None:
    """Frames spread over the test set: the predicted hand in colour and the true one in white, and both in 3-D."""
    hand, data = hand_layer(net), data_layer(net)
    skeleton = hand.skeleton if hand else skeletons.load()
    chosen = np.linspace(0, data.rows - 1, min(count, data.rows)).astype(int)
    depth = data.spec.top.index("depth")
    images = []
    for i in chosen:
        crop = data.row(int(i))[depth][0]
        joints = predictions.joints[i] if predictions.skeleton is None else predictions.skeleton[i]
        truth = predictions.truth[i] if len(predictions.truth[i]) == len(joints) else None
        images.append(hands.overlay(crop, joints, skeleton, truth, zoom=3))
        images.append(hands.view_3d(joints, skeleton, truth, size=384))
    errors = joint_errors(predictions.joints[chosen], predictions.truth[chosen]).mean(axis=1)
    titles = [t for i, e in zip(chosen, errors * predictions.half_cube[chosen]) for t in (f"frame {i}", f"{e:.0f} mm")]
    Path(path).parent.mkdir(parents=True, exist_ok=True)
    pictures.write_image(path, sheets.sheet(images, 6, titles))
    print(f"wrote {path}", file=sys.stderr)


def _table(rows: list[dict[str, object]]) -> str:
    """A table, one snapshot a line."""
    names = [name for name in rows[0] if name != "snapshot"]
    lines = [["snapshot", *(COLUMNS[n][0] if n in COLUMNS else n for n in names)]]
    for row in rows:
        lines.append([str(row["snapshot"]), *(COLUMNS.get(n, ("", "{:.5g}"))[1].format(row[n]) for n in names)])
    return aligned(lines)


if __name__ == "__main__":
    sys.exit(main())
