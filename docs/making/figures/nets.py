"""Figures of chapter 4: the paper's network."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

import netlib
from docs.making.figures.drawing import DEPTH, FIRST, PALE_DATA, SECOND, SIGNS, new_figure
from handpose.estimate.packaged import PAPER_HAND, checked_content, read_card
from handpose.synthetic.generator import Generator
from netlib.engine import Connection
from netlib.files.paths import ROOT

# In pixels of a map: from map to map of a blob, from blob to blob, and the least width of a blob.
SHIFT, GAP, MIN_WIDTH = 5, 30, 20
NAME_Y, SIZE_Y, LAYER_Y = 102, -70, -5  # of the texts above, below and between the maps
JOINT_COORDINATES = 93
BAR_WIDTH = 0.38


def stack() -> Any:
    """The maps of the paper's network to scale, a value one unit of area; below them what
    each layer costs.
    """
    net = netlib.Net(ROOT / "prototxt" / "nyu_deploy.prototxt", netlib.TEST, seed=0, engine="plain")
    figure = new_figure(9.6, 5.2)
    maps, costs = figure.subplots(2, 1, height_ratios=[5, 3])
    steps = [step for step in net.connections if step.layer.spec.top != step.layer.spec.bottom]
    _draw_maps(maps, steps)
    _draw_costs(costs, [step for step in steps if step.layer.blobs])
    return figure


def cost_of(step: Connection) -> tuple[int, int]:
    """The parameters of a layer, biases included, and its multiplications for one picture."""
    parameters = sum(blob.count for blob in step.layer.blobs)
    values = math.prod(step.top[0].shape[1:])
    per_value = math.prod(step.layer.blobs[0].shape[1:])
    return parameters, per_value * values


def _draw_maps(axes: Any, steps: list[Connection]) -> None:
    """Draw the maps of each top from left to right, with an arrow for the layer before each."""
    left = end = 0.0
    for step in steps:
        shape = step.top[0].shape[1:]
        count, height, width = _drawn_as(shape)
        blob_width = width + SHIFT * (count - 1)
        room = max(blob_width, MIN_WIDTH)
        middle = left + room / 2
        begin = middle - blob_width / 2
        _draw_blob(axes, begin, count, height, width)
        name = step.layer.spec.top[0]
        size = "×".join(map(str, shape))
        axes.text(middle, NAME_Y, name, ha="center", va="bottom", fontsize=9, weight="bold")
        axes.text(middle, SIZE_Y, size, ha="center", va="top", fontsize=8.5)
        if step is not steps[0]:
            arrow = {"arrowstyle": "->", "lw": 0.8}
            axes.annotate("", (begin - 3, 0), (end + 3, 0), arrowprops=arrow)
            between = (begin + end) / 2
            title = _title_of(step.layer)
            axes.text(between, LAYER_Y, title, ha="center", va="top", fontsize=7.5)
        end = begin + blob_width
        left += room + GAP
    axes.set(xlim=(-5, left - GAP + 5), ylim=(-88, 116), aspect="equal")
    axes.axis("off")


def _draw_blob(axes: Any, left: float, count: int, height: float, width: float) -> None:
    """Draw the maps of a blob, the last one first."""
    from matplotlib.patches import Rectangle

    for i in reversed(range(count)):
        corner = (left + SHIFT * i, SHIFT * i - height / 2)
        rectangle = Rectangle(corner, width, height, facecolor=PALE_DATA, edgecolor=FIRST, lw=0.7)
        axes.add_patch(rectangle)


def _drawn_as(shape: tuple[int, ...]) -> tuple[int, float, float]:
    """Number, height and width of rectangles.

    Features stand in columns of 128, joints as rows of x, y, z.
    """
    if len(shape) == 3:
        return shape[0], float(shape[1]), float(shape[2])
    [features] = shape
    columns = 3 if features == JOINT_COORDINATES else max(1, features // 128)
    return 1, features / columns, float(columns)


def _title_of(layer: netlib.Layer) -> str:
    """What a layer connects: its kernel, or everything."""
    if layer.type == "Convolution":
        [size] = layer.param.kernel_size
        return f"{size}×{size}"
    if layer.type == "Pooling":
        size = layer.param.kernel_size
        return f"max\n{size}×{size}"
    return {"InnerProduct": "all\nto all", "HandModel": "hand\nmodel"}.get(layer.type, "")


def _draw_costs(axes: Any, steps: list[Connection]) -> None:
    """Draw each layer's share of all parameters and of all multiplications."""
    costs = np.array([cost_of(step) for step in steps]).T
    styles = ("parameters", FIRST, -0.2), ("multiplications", SECOND, 0.2)
    for values, (name, colour, shift) in zip(costs, styles):
        x = np.arange(len(values)) + shift
        shares = 100 * values / values.sum()
        axes.bar(x, shares, BAR_WIDTH, color=colour, label=f"{name}, {values.sum():,} in all")
        for place, share, value in zip(x, shares, values):
            axes.text(place, share + 1, f"{value:,}", ha="center", fontsize=8, color=colour)
    axes.set(ylim=(0, 62), ylabel="% of all")
    names = [step.layer.spec.top[0] for step in steps]
    axes.set_xticks(range(len(steps)), names, fontsize=8)
    axes.legend(fontsize=8, loc="upper right")
    axes.spines[["top", "right"]].set_visible(False)


def kernels() -> Any:
    """One hand, the eight kernels of the packaged network's first convolution, and
    its map for each.
    """
    weights = checked_content(read_card(PAPER_HAND)).path
    net = netlib.Net(PAPER_HAND / "deploy.prototxt", weights, netlib.TEST, engine="plain")
    hand = Generator(seed=0, split="test").block(0).depth[0].reshape(128, 128)
    net.forward(end="ReLUconvL1", depth=hand[None, None])
    figure = new_figure(9.5, 2.4)
    grid = figure.add_gridspec(2, 10)

    def draw(place: Any, image: Any, title: str = "", **options: Any) -> None:
        axes = figure.add_subplot(place)
        axes.imshow(image, **options)
        axes.set_title(title, fontsize=9)
        axes.set_axis_off()

    draw(grid[:, :2], hand, "depth", cmap=DEPTH, vmin=-1, vmax=1)
    w = net.params["convL1"][0].data[:, 0]
    y = net.blobs["convL1"].data[0]
    for i, (kernel, response) in enumerate(zip(w, y)):
        largest = abs(kernel).max()
        draw(grid[0, 2 + i], kernel, f"w[{i}]", cmap=SIGNS, vmin=-largest, vmax=largest)
        draw(grid[1, 2 + i], response, cmap="gray", vmin=0)
    return figure
