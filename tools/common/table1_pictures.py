"""The figures of Table 1, drawn from its recorded results."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from experiments.table1 import page as table1_page
from experiments.table1 import store
from experiments.table1.recipes import RECIPES
from experiments.table1.settings import Setting
from experiments.table1.store import THRESHOLDS_MM, Entry, Shown
from experiments.table1.summary import Line, curve_of, spread_text, value_of
from handpose.fit.joints.angles import rotations
from handpose.output.drawing.sheets import side_by_side
from layers.hand.skeleton import Skeleton
from tools.common import outputs
from tools.common.plots import COLOURS


def write_pictures(out: Path, folder: Path, entries: table1_page.Store, skeleton: Skeleton) -> list[Path]:
    """Draw the figures of the page into the folder ``out`` and return their paths. Raises NetlibError, DataError.

    folder   folder of the recorded results
    entries  results by setting
    """
    setting = table1_page.first_of(entries)
    written: list[Path] = []
    for recipe in RECIPES.values():
        if lines := table1_page.lines_of(entries, setting, recipe):
            shown = store.read_shown(folder, setting.name)
            title = f"{setting.title}, {recipe.title}"
            places = [out / name(recipe) for name in (table1_page.joints_picture, table1_page.angles_picture,
                                                      table1_page.hands_picture)]
            _draw_joints(places[0], lines, skeleton, title)
            _draw_angles(places[1], lines, skeleton, title)
            _draw_hands(places[2], lines, shown, skeleton)
            written += places
        if found := table1_page.lambda_entries(entries.get(setting.name, ()), recipe):
            written.append(out / table1_page.lambda_picture(recipe))
            _draw_lambda(written[-1], found, setting)
    return written


def _counted(line: Line) -> list[Entry]:
    return [found.counts for found in line.by_seed.values() if found.counts]


def _draw_joints(path: Path, lines: Mapping[str, Line], skeleton: Skeleton, title: str) -> None:
    """Draw success rates by maximum error, and the mean error per joint."""
    figure = outputs.new_figure(12, 8.5)
    above, below = figure.subplots(2, 1)
    for colour, line in zip(COLOURS, lines.values()):
        curve = 100 * np.array(curve_of(_counted(line), "success"))
        label = f"{line.network.title}: {spread_text(line.values('error_14_mm').values())} mm"
        above.plot(THRESHOLDS_MM, curve, color=colour, label=label)
    above.set(xlabel="threshold, mm", ylabel="frames with all joints within the threshold, %", xlim=(0, 80),
              ylim=(0, 101), title=title)
    above.legend(frameon=False)
    _bars(below, lines, "joints_mm", skeleton.joint_names)
    below.set(ylabel="mean error, mm")
    _finish(path, figure, (above, below))


def _draw_angles(path: Path, lines: Mapping[str, Line], skeleton: Skeleton, title: str) -> None:
    """Draw the mean error per rotation."""
    figure = outputs.new_figure(12, 5)
    axis = figure.subplots()
    names = [skeleton.dof_names[d].replace("_rot_", " ").replace("_", " ") for d in rotations(skeleton)]
    _bars(axis, lines, "angles_deg", names)
    axis.set(ylabel="mean error, degrees", title=title)
    axis.legend(frameon=False)
    _finish(path, figure, (axis,))


def _bars(axis: Any, lines: Mapping[str, Line], figure: str, names: Sequence[str]) -> None:
    width = 0.8 / len(lines)
    for i, (colour, line) in enumerate(zip(COLOURS, lines.values())):
        left = np.arange(len(names)) - 0.4 + i * width
        axis.bar(left, curve_of(_counted(line), figure), width, align="edge", color=colour, label=line.network.title)
    axis.set_xticks(range(len(names)), names, rotation=60, ha="right")


def _draw_hands(path: Path, lines: Mapping[str, Line], shown: Shown, skeleton: Skeleton) -> None:
    """Draw the recorded hands of all networks, first seed only, with the ground truth in white."""
    methods = {line.network.title: _counted(line)[0].shown for line in lines.values()}
    sheet = side_by_side(shown.crops, methods, shown.truth, skeleton, shown.half_cube)
    outputs.write_image(path, sheet)


def _draw_lambda(path: Path, found: Mapping[tuple[float, str], Entry], setting: Setting) -> None:
    """Plot joint error, angle error and frames out of limits against the weight of PhysLimit; L2 is dashed.

    The axes start at 0: the differences are smaller than those between seeds, and a cut axis would exaggerate them.
    """
    angle = "angle_deg" if setting.has_exact_angles else "fitted_angle_deg"
    rows = (("error_14_mm", "joint error, mm", 1), (angle, "angle error, degrees", 1),
            ("out_of_limits", "frames out of limits, %", 100))
    figure = outputs.new_figure(12, 4)
    axes = figure.subplots(1, 3)
    smallest = min(weight for weight, _ in found if weight) / 10  # position of 0 on the logarithmic axis
    for axis, (name, label, factor) in zip(axes, rows):
        for norm, style, colour in (("L1", "o-", COLOURS[0]), ("L2", "s--", COLOURS[1])):
            points = sorted((weight or smallest, factor * value_of(entry, name))
                            for (weight, of), entry in found.items() if of == norm)
            if points:
                axis.plot(*zip(*points), style, color=colour, label=norm)
        weights = sorted({weight for weight, _ in found})
        axis.set(xscale="log", xlabel="λ", ylabel=label)
        axis.set_ylim(0, 1.15 * axis.get_ylim()[1])
        axis.set_xticks([weight or smallest for weight in weights], [f"{weight:g}" for weight in weights])
        axis.minorticks_off()
    axes[0].legend(frameon=False)
    _finish(path, figure, axes)


def _finish(path: Path, figure: Any, axes: Sequence[Any]) -> None:
    for axis in axes:
        axis.grid(True, axis="y", alpha=0.3)
        axis.set_axisbelow(True)
        axis.spines[["top", "right"]].set_visible(False)
    outputs.write_figure(path, figure, dpi=110)
