#!/usr/bin/env python3
r"""Compare published predictions with the annotation: errors in mm, success rates, errors by joint, the paper's curves.

    python tools/evaluate.py nyu --groundtruth test_groundtruth_uvd.txt --plot nyu.png \
        --predictions DeepModel=IJCAI16_NYU_DeepModel.txt Feedback=ICCV15_NYU_Feedback.txt

Files are text, a frame on each line, three numbers for each joint: u v d (px, px, mm) or x y z (mm, camera axes: x
right, y up, z away). NYU has 14 joints: annotated 0, 3, 6, 9, 12, 15, 18, 21, 24, 25, 27, 30, 31, 32. ICVL has its 16.
Several NAME=FILE make one table and one picture. Errors are distances between absolute positions: no crop centre and
no cube is involved.

--angles (NYU) also fits the hand model to all joints, a minute or two a method, and compares its angles: the mean
over the 23 rotations, in canonical form. The annotation is fitted within the limits with a ridge of 0.003, which keeps
angles that 14 joints do not determine at the initial pose; predictions within the limits without a ridge. Where most
frames lie on the model to 0.05 mm, those with an angle out of its limits are counted, from a fit without them.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

import netlib  # noqa: F401  before NumPy: it chooses BLAS kernels

# isort: split

import numpy as np
from numpy.typing import NDArray

from handpose.facts import nyu
from handpose.fitting import angles
from handpose.fitting.levenberg_marquardt import fit_joints
from handpose.scoring import metrics
from handpose.scoring.metrics import joint_errors
from handpose.scoring.published_predictions import (
    BENCHMARKS,
    FORMATS,
    THRESHOLDS_MM,
    Benchmark,
    Score,
    read_joints,
    score_on,
)
from layers.hand import skeleton as skeletons
from netlib.errors import DataError
from tools import pictures
from tools.console import DONE, aligned, guarded, progress_bar

Array = NDArray[np.float64]

PICTURES = (".png", ".svg", ".pdf")
WITHIN_MM = (20, 40, 60, 80)  # columns of the table; the curves have every mm
IMPLAUSIBLE_MM = 50.0  # a mean error of no method, but of files with other axes (y down: 62 mm on ICVL) or frames
RIDGE = 3e-3  # of the annotation's angles
ON_MODEL_MM = 0.05  # residual of most frames if a hand model made their joints; with few starts some fit badly
TOLERANCE = 1e-3  # radians beyond a limit that count as within: joints in text files are rounded
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#56B4E9", "#E69F00", "#000000")  # Okabe and Ito, without yellow
LINES = ("-", "--", ":", "-.")  # for each round of the colours
HATCHES = ("", "///", "...", "xxx")


def main(argv: list[str] | None = None) -> int:
    """Run the tool; returns the exit status."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("dataset", metavar="DATASET", choices=BENCHMARKS, help=" or ".join(BENCHMARKS))
    parser.add_argument("--groundtruth", metavar="FILE", required=True, help="the annotated joints")
    parser.add_argument("--predictions", metavar="NAME=FILE", required=True, nargs="+", action="extend", type=_named,
                        help="the joints that each method predicts")  # fmt: skip
    parser.add_argument("--format", choices=FORMATS, default="uvd", help="of predictions (default: %(default)s)")
    parser.add_argument("--groundtruth-format", choices=FORMATS, default="uvd", help="default: %(default)s")
    parser.add_argument("--plot", metavar="FILE", help=f"draw the curves and bars ({', '.join(PICTURES)})")
    parser.add_argument("--angles", action="store_true", help="compare joint angles too, by fitting the hand (NYU)")
    parser.add_argument("--json", action="store_true", help="print JSON, with the curves, instead of tables")
    args = parser.parse_args(argv)
    names = [name for name, _ in args.predictions]
    for name in names:
        if names.count(name) > 1:
            parser.error(f"--predictions: the name {name!r} is given {names.count(name)} times")
    if args.plot is not None and not args.plot.lower().endswith(PICTURES):
        parser.error(f"--plot must end in {', '.join(PICTURES)}, found {args.plot}")
    if args.angles and args.dataset != "nyu":
        parser.error("--angles is for nyu: the hand model's limits are those of its hand")
    return guarded(lambda: run(args))


def _named(text: str) -> tuple[str, str]:
    """The two halves of NAME=FILE."""
    name, _, path = text.partition("=")
    if not name.strip() or not path:
        raise argparse.ArgumentTypeError(f"expected NAME=FILE, found {text!r}")
    return name.strip(), path


def run(args: argparse.Namespace) -> int:
    """Compare as the parsed arguments say."""
    benchmark = BENCHMARKS[args.dataset]()
    truth = read_joints(args.groundtruth, len(benchmark.joints), args.groundtruth_format, benchmark.camera)
    scores, predictions = {}, {}
    for name, path in args.predictions:
        predicted = read_joints(path, len(benchmark.joints), args.format, benchmark.camera)
        if len(predicted) != len(truth):
            raise DataError(f"{path}: {len(predicted)} frames, the ground truth {args.groundtruth} has {len(truth)}")
        predictions[name] = predicted
        scores[name] = score_on(benchmark, joint_errors(predicted, truth))
        if scores[name].mean_mm > IMPLAUSIBLE_MM:
            print(f"warning: {path}: a mean error of {scores[name].mean_mm:.0f} mm; are these {args.format}, "
                  f"y up if xyz, of the same {benchmark.name} frames?", file=sys.stderr)  # fmt: skip
    if args.plot:
        plot(scores, benchmark, len(truth), args.plot)
    fitted = compare_angles(truth, predictions) if args.angles else {}
    if args.json:
        print(_json(scores, fitted, benchmark, len(truth), args))
    else:
        print(_tables(scores, benchmark, len(truth)))
        if fitted:
            rows = [_ANGLE_HEADS, *([name, *found.cells()] for name, found in fitted.items())]
            print(f"\nangles of the fitted hand\n\n{aligned(rows)}")
    return DONE


_ANGLE_HEADS = ["method", "angle error", "residual within limits", "without limits", "frames out of limits"]


@dataclasses.dataclass(frozen=True)
class Angles:
    """What fitting the hand model to the joints of a method tells."""

    error_deg: float  # mean over frames and rotations
    residual_mm: float  # mean distance that the fit within the limits leaves
    free_residual_mm: float  # without limits
    out_of_limits: float | None  # fraction of the frames; None where the joints do not lie on the model

    def cells(self) -> list[str]:
        """The figures as text."""
        broken = "not of this model" if self.out_of_limits is None else f"{self.out_of_limits:.2%}"
        return [f"{self.error_deg:.2f} deg", f"{self.residual_mm:.3f} mm", f"{self.free_residual_mm:.4f} mm", broken]


def compare_angles(truth: Array, predictions: Mapping[str, Array]) -> dict[str, Angles]:
    """Fit the hand to true joints (N, 14, 3) in mm and to those of each method, and compare."""
    skeleton = skeletons.load()
    half = nyu.half_cubes(len(truth))
    if warning := nyu.one_size_for_all(len(truth)):
        print(warning, file=sys.stderr)

    def fitted(joints: Array, what: str, **options: Any) -> tuple[Array, Array]:
        """Inputs (N, D), and the mean distance (N,) in mm that each frame's joints are left with."""
        targets = (joints - joints.mean(axis=1, keepdims=True)) / half[:, None, None]
        bar = progress_bar(len(joints), 0, " frames")
        if bar:
            bar.set_description(what)
        found = fit_joints(
            skeleton, targets, nyu.EVALUATION_JOINTS, progress=bar.update if bar else lambda done: None, **options
        )
        if bar:
            bar.close()
        return found.inputs, found.residuals.mean(axis=1) * half

    true_inputs, _ = fitted(truth, "annotation", ridge=RIDGE)
    results = {}
    for name, joints in predictions.items():
        inputs, residual = fitted(joints, name)
        free, free_residual = fitted(joints, f"{name}, no limits", limits=False, starts=2)
        broken = None
        if np.median(free_residual) < ON_MODEL_MM:
            free, free_residual = fitted(joints, f"{name}, exactly", limits=False, starts=256)
            broken = metrics.fraction_out_of_limits(
                free, skeleton.lower, skeleton.upper, skeleton.fixed, tolerance=TOLERANCE
            )
        error = float(angles.angle_errors(skeleton, inputs, true_inputs).mean())
        results[name] = Angles(error, float(residual.mean()), float(free_residual.mean()), broken)
    return results


def _json(
    scores: dict[str, Score], fitted: dict[str, Angles], benchmark: Benchmark, frames: int, args: argparse.Namespace
) -> str:
    files = dict(args.predictions)
    facts = {
        "dataset": benchmark.name,
        "groundtruth": args.groundtruth,
        "frames": frames,
        "joints": len(benchmark.joints),
        "positions": "absolute, camera axes",
        "thresholds_mm": list(THRESHOLDS_MM),
        "methods": [
            {"name": name, "file": files[name], **dataclasses.asdict(s)}
            | ({"angles": dataclasses.asdict(fitted[name])} if fitted else {})
            for name, s in scores.items()
        ],
    }
    return json.dumps(facts, indent=2, allow_nan=False)


def _tables(scores: dict[str, Score], benchmark: Benchmark, frames: int) -> str:
    """What the figures are, a table with a method a line, and one with a joint a line."""
    some = "" if frames == benchmark.frames else f" of the test set's {benchmark.frames}"
    parts = list(next(iter(scores.values())).parts_mm)
    methods = [["method", "mean", *parts, "median of max", *(f"max <= {t} mm" for t in WITHIN_MM)]]
    for name, s in scores.items():
        means = [f"{error:.2f}" for error in (s.mean_mm, *s.parts_mm.values(), s.median_max_mm)]
        methods.append([name, *means, *(f"{s.success_max[t]:.1%}" for t in WITHIN_MM)])
    joints = [["joint", *scores]]
    for joint in benchmark.joints:
        joints.append([joint, *(f"{s.joints_mm[joint]:.2f}" for s in scores.values())])
    joints.append(["mean", *(f"{s.mean_mm:.2f}" for s in scores.values())])
    return (
        f"{benchmark.name}, {frames} frames{some}, {len(benchmark.joints)} joints: errors in mm between absolute "
        "positions in camera axes;\nmax is the worst joint of a frame\n\n"
        f"{aligned(methods)}\n\nmean error by joint, mm\n\n{aligned(joints)}"
    )


def plot(scores: dict[str, Score], benchmark: Benchmark, frames: int, out: str | Path) -> None:
    """Success curves by worst and by mean error, and errors by joint. Raises NetlibError if they cannot be written."""
    figure = pictures.new_figure(12, 8.5)
    axes = figure.subplot_mosaic([["max", "mean"], ["joints", "joints"]])
    _draw_curves(axes["max"], [s.success_max for s in scores.values()], "all joints")
    _draw_curves(axes["mean"], [s.success_mean for s in scores.values()], "mean error")
    _draw_bars(axes["joints"], list(scores.values()), benchmark.joints)
    for axis in axes.values():
        axis.set_axisbelow(True)
        axis.spines[["top", "right"]].set_visible(False)
    labels = [f"{s.mean_mm:.2f} mm  {name}".replace("$", r"\$") for name, s in scores.items()]  # no formula
    figure.legend(axes["max"].lines, labels, loc="outside upper center", ncols=min(len(labels), 4), frameon=False,
                  title=f"{benchmark.name}: mean error over {frames} frames and {len(benchmark.joints)} joints",
                  title_fontsize="large")  # fmt: skip
    pictures.write_figure(out, figure, dpi=130)
    print(f"wrote {out}", file=sys.stderr)


def _draw_curves(axis: Any, curves: list[list[float]], what: str) -> None:
    for i, rates in enumerate(curves):
        turn, colour = divmod(i, len(COLOURS))
        line = LINES[turn % len(LINES)]
        axis.plot(THRESHOLDS_MM, [100 * rate for rate in rates], line, color=COLOURS[colour], linewidth=1.8)
    axis.set(xlabel="threshold, mm", ylabel=f"frames with {what} within the threshold, %")
    axis.set(xlim=(0, THRESHOLDS_MM[-1]), ylim=(0, 101))
    axis.grid(True, alpha=0.3)


def _draw_bars(axis: Any, scores: list[Score], joints: Sequence[str]) -> None:
    width = 0.8 / len(scores)
    places = [*range(len(joints)), len(joints) + 0.5]  # the mean stands a little apart
    for i, s in enumerate(scores):
        turn, colour = divmod(i, len(COLOURS))
        left = [place - 0.4 + i * width for place in places]
        axis.bar(left, [*s.joints_mm.values(), s.mean_mm], width, align="edge", color=COLOURS[colour],
                 hatch=HATCHES[turn % len(HATCHES)], edgecolor="white", linewidth=0.4)  # fmt: skip
    axis.set_xticks(places, [*(joint.replace("_", "\n", 1).replace("_", " ") for joint in joints), "mean"])
    axis.tick_params(axis="x", length=0)
    axis.set(ylabel="mean error, mm", xlim=(-0.6, places[-1] + 0.6))
    axis.grid(True, axis="y", alpha=0.3)


if __name__ == "__main__":
    sys.exit(main())
