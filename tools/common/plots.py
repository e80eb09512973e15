"""Plots of errors: success rate by threshold, errors per joint and per angle."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from handpose.scoring.published_predictions import THRESHOLDS_MM, Benchmark, Score
from tools.common import outputs

COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#56B4E9", "#E69F00", "#000000")  # Okabe-Ito, without yellow
LINES = ("-", "--", ":", "-.")  # for repeated colours
HATCHES = ("", "///", "...", "xxx")


def plot_joint_errors(scores: Mapping[str, Score], benchmark: Benchmark, frames: int, out: str | Path) -> None:
    """Plot success rates by maximum and by mean error, and mean errors per joint. Raises NetlibError."""
    figure = outputs.new_figure(12, 8.5)
    axes = figure.subplot_mosaic([["max", "mean"], ["joints", "joints"]])
    _draw_curves(axes["max"], [s.success_max for s in scores.values()], "all joints")
    _draw_curves(axes["mean"], [s.success_mean for s in scores.values()], "mean error")
    _draw_bars(axes["joints"], list(scores.values()), benchmark.joints)
    for axis in axes.values():
        axis.set_axisbelow(True)
        axis.spines[["top", "right"]].set_visible(False)
    labels = [f"{s.mean_mm:.2f} mm  {outputs.label(name)}" for name, s in scores.items()]
    figure.legend(axes["max"].lines, labels, loc="outside upper center", ncols=min(len(labels), 4), frameon=False,
                  title=f"{benchmark.name}: mean error over {frames} frames and {len(benchmark.joints)} joints",
                  title_fontsize="large")
    outputs.write_figure(out, figure, dpi=130)


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
    places = [*range(len(joints)), len(joints) + 0.5]  # a gap before the mean
    for i, s in enumerate(scores):
        turn, colour = divmod(i, len(COLOURS))
        left = [place - 0.4 + i * width for place in places]
        axis.bar(left, [*s.joints_mm.values(), s.mean_mm], width, align="edge", color=COLOURS[colour],
                 hatch=HATCHES[turn % len(HATCHES)], edgecolor="white", linewidth=0.4)
    axis.set_xticks(places, [*(joint.replace("_", "\n", 1).replace("_", " ") for joint in joints), "mean"])
    axis.tick_params(axis="x", length=0)
    axis.set(ylabel="mean error, mm", xlim=(-0.6, places[-1] + 0.6))
    axis.grid(True, axis="y", alpha=0.3)
