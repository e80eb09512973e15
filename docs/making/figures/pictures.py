"""Figures of chapter 4."""

from __future__ import annotations

import functools
from dataclasses import dataclass
from typing import Any

import numpy as np

import netlib
from docs.making.figures.drawn import new_figure
from docs.making.palette import DEPTH, FIRST, PALE_DATA, SECOND, SIGNS
from handpose.estimate.packaged import PAPER_HAND, checked_weights, read_card
from handpose.synthetic.generator import Generator
from netlib.blob import Array
from netlib.files.paths import ROOT

SHIFT, GAP, ROOM = 5, 30, 20  # from map to map, from blob to blob, for a blob at least; a pixel of a map is 1


@dataclass(frozen=True)
class Stage:
    """A blob of the net, and what the layer that writes it costs for one picture."""

    blob: str
    does: str  # the layer
    shape: tuple[int, ...]  # of one picture
    parameters: int
    multiplications: int


def stages(net: netlib.Net) -> list[Stage]:
    """The blobs in the order of their layers; in-place layers have no blob."""
    found = []
    for at in net.connections:
        if at.layer.spec.top == at.layer.spec.bottom:
            continue
        shape = at.top[0].shape[1:]
        parameters = sum(blob.count for blob in at.layer.blobs)
        weights = at.layer.blobs[0].shape if at.layer.blobs else (1, 0)
        each = int(np.prod(weights[1:]))  # multiplications for one value of the top
        found.append(Stage(at.layer.spec.top[0], _does(at.layer), shape, parameters, each * int(np.prod(shape))))
    return found


def _does(layer: netlib.Layer) -> str:
    p = layer.param
    if layer.type == "Convolution":
        return f"{p.kernel_size[0]}×{p.kernel_size[0]}"
    if layer.type == "Pooling":
        return f"max\n{p.kernel_size}×{p.kernel_size}"
    return {"InnerProduct": "all\nto all", "HandModel": "hand\nmodel"}.get(layer.type, "")


def stack() -> Any:
    """The maps of the paper's network to scale, a value one unit of area; below them what each layer costs."""
    found = stages(netlib.Net(ROOT / "prototxt" / "nyu_deploy.prototxt", netlib.TEST, seed=0, engine="plain"))
    figure = new_figure(9.6, 5.2)
    maps, costs = figure.subplots(2, 1, height_ratios=[5, 3])
    _draw_maps(maps, found)
    _draw_costs(costs, [stage for stage in found if stage.parameters])
    return figure


def _draw_maps(axes: Any, found: list[Stage]) -> None:
    from matplotlib.patches import Rectangle

    left = end = 0.0
    for stage in found:
        count, height, width = _drawn_as(stage.shape)
        wide = width + SHIFT * (count - 1)
        room = max(wide, ROOM)
        begin = left + (room - wide) / 2
        for i in reversed(range(count)):
            corner = (begin + SHIFT * i, SHIFT * i - height / 2)
            axes.add_patch(Rectangle(corner, width, height, facecolor=PALE_DATA, edgecolor=FIRST, lw=0.7))
        axes.text(left + room / 2, 102, stage.blob, ha="center", va="bottom", fontsize=9, weight="bold")
        axes.text(left + room / 2, -70, "×".join(map(str, stage.shape)), ha="center", va="top", fontsize=8.5)
        if stage is not found[0]:
            axes.annotate("", (begin - 3, 0), (end + 3, 0), arrowprops={"arrowstyle": "->", "lw": 0.8})
            axes.text((begin + end) / 2, -5, stage.does, ha="center", va="top", fontsize=7.5)
        end, left = begin + wide, left + room + GAP
    axes.set(xlim=(-5, left - GAP + 5), ylim=(-88, 116), aspect="equal")
    axes.axis("off")


def _draw_costs(axes: Any, found: list[Stage]) -> None:
    for name, colour, aside in (("parameters", FIRST, -0.2), ("multiplications", SECOND, 0.2)):
        values = [getattr(stage, name) for stage in found]
        places, shares = np.arange(len(values)) + aside, 100 * np.array(values) / sum(values)
        axes.bar(places, shares, 0.38, color=colour, label=f"{name}, {sum(values):,} in all")
        for place, share, value in zip(places, shares, values):
            axes.text(place, share + 1, f"{value:,}", ha="center", fontsize=8, color=colour)
    axes.set(ylim=(0, 62), ylabel="% of all")
    axes.set_xticks(range(len(found)), [stage.blob for stage in found], fontsize=8)
    axes.legend(fontsize=8, loc="upper right")
    axes.spines[["top", "right"]].set_visible(False)


def _drawn_as(shape: tuple[int, ...]) -> tuple[int, float, float]:
    """How many rectangles, how high, how wide. Features stand in columns of 128, joints as rows of x, y, z."""
    if len(shape) == 3:
        return shape[0], float(shape[1]), float(shape[2])
    wide = 3 if shape[0] == 93 else max(1, shape[0] // 128)
    return 1, shape[0] / wide, float(wide)


@functools.cache
def first_maps() -> tuple[Array, Array, Array]:
    """A rendered hand (128, 128), the packaged network's first kernels (8, 5, 5), its first maps (8, 124, 124)."""
    weights = checked_weights(read_card(PAPER_HAND))
    net = netlib.Net(PAPER_HAND / "deploy.prototxt", weights, netlib.TEST, engine="plain")
    hand = Generator(seed=0, split="test").block(0).depth[0]
    net.forward(end="ReLUconvL1", depth=hand.reshape(1, 1, 128, 128))
    return hand.reshape(128, 128), net.params["convL1"][0].data[:, 0], net.blobs["convL1"].data[0]


def kernels() -> Any:
    """One hand, the eight kernels of the first convolution, and what each makes of the hand."""
    hand, w, y = first_maps()
    figure = new_figure(9.5, 2.4)
    grid = figure.add_gridspec(2, 10)
    axes = figure.add_subplot(grid[:, :2])
    axes.imshow(hand, cmap=DEPTH, vmin=-1, vmax=1)
    axes.set_title("depth", fontsize=9)
    axes.set_axis_off()
    for i, (kernel, seen) in enumerate(zip(w, y)):
        most = abs(kernel).max()
        axes = figure.add_subplot(grid[0, 2 + i])
        axes.imshow(kernel, cmap=SIGNS, vmin=-most, vmax=most)
        axes.set_title(f"w[{i}]", fontsize=9)
        axes.set_axis_off()
        axes = figure.add_subplot(grid[1, 2 + i])
        axes.imshow(seen, cmap="gray", vmin=0)
        axes.set_axis_off()
    return figure
