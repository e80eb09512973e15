#!/usr/bin/env python3
r"""Score published predictions: errors in mm, success rates, errors per joint, the
curves of the paper.

    python tools/evaluate.py nyu --groundtruth nyu_test_groundtruth_label.txt --plot nyu.png \
        --predictions DeepModel=IJCAI16_NYU_DeepModel.txt Feedback=ICCV15_NYU_Feedback.txt

Files are text with one frame per line and three numbers per joint: u v d (px, px, mm) or x y z
(mm, camera axes: x right, y up, z away). NYU has 14 joints: annotated 0, 3, 6, 9, 12, 15, 18, 21,
24, 25, 27, 30, 31, 32. ICVL has its 16. HANDS 2017 (also BigHand2.2M) has 21, as x y z with y down
after the name of the image, by which frames are matched:

    python tools/evaluate.py hands2017 --groundtruth labels.txt --predictions Mine=result.txt

Several NAME=FILE are compared in one table and one figure. Errors are distances between absolute
positions, independent of crop centres and cubes.

--angles (NYU) also fits the hand model to all joints, which takes one or two minutes per method,
and compares its angles: the mean over the 23 rotations, in canonical form. The annotation is fitted
within the limits with a ridge of 0.003, which keeps angles that 14 joints do not determine near the
initial pose; predictions are fitted within the limits without a ridge. If most frames fit the model
to 0.05 mm, a fit without limits counts the frames that violate them.
"""

from __future__ import annotations

import argparse
import itertools
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

import tools

tools.begin(__name__)

from handpose.body import nyu
from handpose.scoring import published_predictions as published
from handpose.scoring.metrics import joint_errors
from handpose.scoring.published_predictions import (
    BENCHMARKS,
    COORDINATE_FORMATS,
    THRESHOLDS_MM,
    Benchmark,
    FittedAngles,
    Score,
)
from layers.hand import skeleton as skeletons
from netlib.errors import DataError
from tools.common import outputs
from tools.common.arguments import expected, name_in, parser_of
from tools.common.console import aligned, guarded, notify
from tools.common.progress import ProgressBar

PICTURES = (".png", ".svg", ".pdf")
# Okabe-Ito, without yellow
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#56B4E9", "#E69F00", "#000000")
WITHIN_MM = (20, 40, 60, 80)  # columns of the table; the curves have a value per mm
IMPLAUSIBLE_MM = 50.0  # a mean error caused by wrong axes (y down: 62 mm on ICVL) or frames


def main(argv: list[str] | None = None) -> int:
    """Run the tool; returns the exit status."""
    parser = parser_of(__doc__)
    parser.add_argument(
        "dataset", metavar="DATASET", choices=BENCHMARKS, help=" or ".join(BENCHMARKS)
    )
    parser.add_argument("--groundtruth", metavar="FILE", required=True, help="annotated joints")
    parser.add_argument(
        "--predictions",
        metavar="NAME=FILE",
        required=True,
        nargs="+",
        action="extend",
        type=_named_file,
        help="predicted joints of each method",
    )
    parser.add_argument(
        "--format", choices=COORDINATE_FORMATS, help=f"of predictions (default: {_formats()})"
    )
    parser.add_argument("--groundtruth-format", choices=COORDINATE_FORMATS, help="likewise")
    parser.add_argument(
        "--plot",
        metavar="FILE",
        type=name_in(*PICTURES),
        help=f"draw curves and bars to this file ({', '.join(PICTURES)})",
    )
    parser.add_argument(
        "--angles", action="store_true", help="also compare joint angles of the fitted hand (NYU)"
    )
    args = parser.parse_args(argv)
    names = [name for name, _ in args.predictions]
    for name in names:
        if names.count(name) > 1:
            parser.error(f"--predictions: the name {name!r} is given {names.count(name)} times")
    if args.angles and args.dataset != "nyu":
        parser.error("--angles applies only to nyu, whose hand has the limits of the model")
    return guarded(run, args)


def run(args: argparse.Namespace) -> None:
    """Score the predictions."""
    if args.plot:
        outputs.refuse_inputs(
            args.plot, [args.groundtruth, *(path for _, path in args.predictions)]
        )
    benchmark = BENCHMARKS[args.dataset]
    count, camera, is_y_down = len(benchmark.joints), benchmark.camera, benchmark.is_y_down
    fmt, true_fmt = args.format or benchmark.format, args.groundtruth_format or benchmark.format
    true_names, truth = published.read_frames(args.groundtruth, count, true_fmt, camera, is_y_down)
    scores = {}
    predictions = {}
    for name, path in args.predictions:
        names, predicted = published.read_frames(path, count, fmt, camera, is_y_down)
        predicted = published.in_order(names, predicted, true_names, path)
        if len(predicted) != len(truth):
            raise DataError(
                f"{path}: {len(predicted)} frames, the ground truth {args.groundtruth} has {len(truth)}"
            )
        predictions[name] = predicted
        scores[name] = published.score_on(benchmark, joint_errors(predicted, truth))
        if scores[name].mean_mm > IMPLAUSIBLE_MM:
            notify(
                f"warning: {path}: the mean error is {scores[name].mean_mm:.0f} mm; check that the format is "
                f"{fmt}, y {'down' if is_y_down else 'up'} if xyz, and that the frames are those of {benchmark.name}"
            )
    if args.plot:
        plot(scores, benchmark, len(truth), args.plot)
        notify(f"wrote {args.plot}")
    print(_tables(scores, benchmark, len(truth)))
    if args.angles:
        if warning := nyu.one_size_for_all(len(truth)):
            notify(warning)
        fitted = published.compare_angles(skeletons.load(), truth, predictions, ProgressBar)
        print(f"\nangles of the fitted hand\n\n{_angle_table(fitted)}")


def _formats() -> str:
    """``uvd for nyu, xyz for hands2017``."""
    return ", ".join(f"{benchmark.format} for {name}" for name, benchmark in BENCHMARKS.items())


def _named_file(text: str) -> tuple[str, str]:
    """Split NAME=FILE."""
    name, _, path = text.partition("=")
    if not name.strip() or not path:
        raise expected("NAME=FILE", text)
    return name.strip(), path


def _tables(scores: dict[str, Score], benchmark: Benchmark, frames: int) -> str:
    """Format a heading, a table with one line per method, and one with one line per joint."""
    some = "" if frames == benchmark.frames else f" of the test set's {benchmark.frames}"
    parts = list(next(iter(scores.values())).parts_mm)
    methods = [["method", "mean", *parts, "median of max", *(f"max <= {t} mm" for t in WITHIN_MM)]]
    for name, s in scores.items():
        means = [f"{error:.2f}" for error in (s.mean_mm, *s.parts_mm.values(), s.median_max_mm)]
        methods.append([name, *means, *(f"{s.success_max[t]:.1%}" for t in WITHIN_MM)])
    errors = (
        [joint, *(f"{s.joints_mm[joint]:.2f}" for s in scores.values())]
        for joint in benchmark.joints
    )
    joints = [["joint", *scores], *errors, ["mean", *(f"{s.mean_mm:.2f}" for s in scores.values())]]
    return (
        f"{benchmark.name}, {frames} frames{some}, {len(benchmark.joints)} joints: errors in mm between absolute "
        "positions in camera axes;\nmax is the worst joint of a frame\n\n"
        f"{aligned(methods)}\n\nmean error by joint, mm\n\n{aligned(joints)}"
    )


def _angle_table(fitted: dict[str, FittedAngles]) -> str:
    rows = [
        [
            "method",
            "angle error",
            "residual within limits",
            "without limits",
            "frames out of limits",
        ]
    ]
    for name, f in fitted.items():
        broken = "not of this model" if f.out_of_limits is None else f"{f.out_of_limits:.2%}"
        rows.append(
            [
                name,
                f"{f.error_deg:.2f} deg",
                f"{f.residual_mm:.3f} mm",
                f"{f.free_residual_mm:.4f} mm",
                broken,
            ]
        )
    return aligned(rows)


def plot(scores: Mapping[str, Score], benchmark: Benchmark, frames: int, out: str | Path) -> None:
    """Plot success rates by maximum and by mean error, and mean errors per joint.

    Raises NetlibError.
    """
    figure = outputs.new_figure(12, 8.5)
    axes = figure.subplot_mosaic([["max", "mean"], ["joints", "joints"]])
    _draw_curves(axes["max"], [s.success_max for s in scores.values()], "all joints")
    _draw_curves(axes["mean"], [s.success_mean for s in scores.values()], "mean error")
    _draw_bars(axes["joints"], list(scores.values()), benchmark.joints)
    for axis in axes.values():
        axis.set_axisbelow(True)
        axis.spines[["top", "right"]].set_visible(False)
    labels = [f"{s.mean_mm:.2f} mm  {outputs.label(name)}" for name, s in scores.items()]
    figure.legend(
        axes["max"].lines,
        labels,
        loc="outside upper center",
        ncols=min(len(labels), 4),
        frameon=False,
        title=f"{benchmark.name}: mean error over {frames} frames and {len(benchmark.joints)} joints",
        title_fontsize="large",
    )
    outputs.write_figure(out, figure, dpi=130)


def _draw_curves(axis: Any, curves: list[list[float]], what: str) -> None:
    for rates, colour in zip(curves, itertools.cycle(COLOURS)):
        axis.plot(THRESHOLDS_MM, [100 * rate for rate in rates], color=colour, linewidth=1.8)
    axis.set(xlabel="threshold, mm", ylabel=f"frames with {what} within the threshold, %")
    axis.set(xlim=(0, THRESHOLDS_MM[-1]), ylim=(0, 101))
    axis.grid(True, alpha=0.3)


def _draw_bars(axis: Any, scores: list[Score], joints: Sequence[str]) -> None:
    width = 0.8 / len(scores)
    places = [*range(len(joints)), len(joints) + 0.5]  # a gap before the mean
    for i, (s, colour) in enumerate(zip(scores, itertools.cycle(COLOURS))):
        left = [place - 0.4 + i * width for place in places]
        axis.bar(
            left,
            [*s.joints_mm.values(), s.mean_mm],
            width,
            align="edge",
            color=colour,
            edgecolor="white",
            linewidth=0.4,
        )
    axis.set_xticks(
        places, [*(joint.replace("_", "\n", 1).replace("_", " ") for joint in joints), "mean"]
    )
    axis.tick_params(axis="x", length=0)
    axis.set(ylabel="mean error, mm", xlim=(-0.6, places[-1] + 0.6))
    axis.grid(True, axis="y", alpha=0.3)


if __name__ == "__main__":
    sys.exit(main())
