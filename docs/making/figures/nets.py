"""Figures of chapters 4 and 5: the paper's network."""

from __future__ import annotations

from typing import Any

import numpy as np

import netlib
from docs.making.figures.drawing import new_figure
from docs.making.figures.palette import DEPTH, DIFF, FIRST, PALE_DATA, PALE_DIFF, PALE_REST, PALM, SECOND, SIGNS
from handpose.estimate.packaged import PAPER_HAND, checked_weights, read_card
from handpose.synthetic.generator import Generator
from netlib.engine.plain import Connection
from netlib.files.paths import ROOT
from netlib.proto import prototxt, schema
from netlib.proto.messages import LayerParameter
from netlib.proto.net_parameter import load_parameter

SHIFT, GAP, ROOM = 5, 30, 20  # from map to map, from blob to blob, at least for a blob; a pixel of a map is 1
ARROW = {"arrowstyle": "->", "shrinkA": 0, "shrinkB": 0}


def stack() -> Any:
    """The maps of the paper's network to scale, a value one unit of area; below them what each layer costs."""
    net = netlib.Net(ROOT / "prototxt" / "nyu_deploy.prototxt", netlib.TEST, seed=0, engine="plain")
    figure = new_figure(9.6, 5.2)
    maps, costs = figure.subplots(2, 1, height_ratios=[5, 3])
    connections = [at for at in net.connections if at.layer.spec.top != at.layer.spec.bottom]
    _draw_maps(maps, connections)
    _draw_costs(costs, [at for at in connections if at.layer.blobs])
    return figure


def cost_of(at: Connection) -> tuple[int, int]:
    """The parameters of a layer, biases included, and its multiplications for one picture."""
    per_value = int(np.prod(at.layer.blobs[0].shape[1:]))  # of the top
    return sum(blob.count for blob in at.layer.blobs), per_value * int(np.prod(at.top[0].shape[1:]))


def _draw_maps(axes: Any, connections: list[Connection]) -> None:
    from matplotlib.patches import Rectangle

    left = end = 0.0
    for at in connections:
        shape = at.top[0].shape[1:]
        count, height, width = _drawn_as(shape)
        wide = width + SHIFT * (count - 1)
        room = max(wide, ROOM)
        begin = left + (room - wide) / 2
        for i in reversed(range(count)):
            corner = (begin + SHIFT * i, SHIFT * i - height / 2)
            axes.add_patch(Rectangle(corner, width, height, facecolor=PALE_DATA, edgecolor=FIRST, lw=0.7))
        axes.text(left + room / 2, 102, at.layer.spec.top[0], ha="center", va="bottom", fontsize=9, weight="bold")
        axes.text(left + room / 2, -70, "×".join(map(str, shape)), ha="center", va="top", fontsize=8.5)
        if at is not connections[0]:
            axes.annotate("", (begin - 3, 0), (end + 3, 0), arrowprops={"arrowstyle": "->", "lw": 0.8})
            axes.text((begin + end) / 2, -5, _title_of(at.layer), ha="center", va="top", fontsize=7.5)
        end, left = begin + wide, left + room + GAP
    axes.set(xlim=(-5, left - GAP + 5), ylim=(-88, 116), aspect="equal")
    axes.axis("off")


def _drawn_as(shape: tuple[int, ...]) -> tuple[int, float, float]:
    """Number, height and width of rectangles. Features stand in columns of 128, joints as rows of x, y, z."""
    if len(shape) == 3:
        return shape[0], float(shape[1]), float(shape[2])
    wide = 3 if shape[0] == 93 else max(1, shape[0] // 128)
    return 1, shape[0] / wide, float(wide)


def _title_of(layer: netlib.Layer) -> str:
    if layer.type == "Convolution":
        return f"{layer.param.kernel_size[0]}×{layer.param.kernel_size[0]}"
    if layer.type == "Pooling":
        return f"max\n{layer.param.kernel_size}×{layer.param.kernel_size}"
    return {"InnerProduct": "all\nto all", "HandModel": "hand\nmodel"}.get(layer.type, "")


def _draw_costs(axes: Any, connections: list[Connection]) -> None:
    costs = np.array([cost_of(at) for at in connections]).T
    for values, name, colour, shift in zip(costs, ("parameters", "multiplications"), (FIRST, SECOND), (-0.2, 0.2)):
        places, shares = np.arange(len(values)) + shift, 100 * values / values.sum()
        axes.bar(places, shares, 0.38, color=colour, label=f"{name}, {values.sum():,} in all")
        for place, share, value in zip(places, shares, values):
            axes.text(place, share + 1, f"{value:,}", ha="center", fontsize=8, color=colour)
    axes.set(ylim=(0, 62), ylabel="% of all")
    axes.set_xticks(range(len(connections)), [at.layer.spec.top[0] for at in connections], fontsize=8)
    axes.legend(fontsize=8, loc="upper right")
    axes.spines[["top", "right"]].set_visible(False)


def kernels() -> Any:
    """One hand, the eight kernels of the packaged network's first convolution, and its map for each."""
    weights = checked_weights(read_card(PAPER_HAND))
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
    for i, (kernel, response) in enumerate(zip(net.params["convL1"][0].data[:, 0], net.blobs["convL1"].data[0])):
        most = abs(kernel).max()
        draw(grid[0, 2 + i], kernel, f"w[{i}]", cmap=SIGNS, vmin=-most, vmax=most)
        draw(grid[1, 2 + i], response, cmap="gray", vmin=0)
    return figure


# ---------------------------------------------------------------------------------------------- the graph

WIDTH, HEIGHT, STEP, COLUMN = 2.3, 0.62, 1.15, 4.6  # of a box; from row to row, from column to column
SIDE, SHIFTED = 6.4, 0.2  # x of long arrows; distance between an arrow forwards and one backwards
RUNS, RESTS = DIFF, PALM  # colours of what runs backwards, and of what does not
Place = tuple[float, float]


def whole_net() -> Any:
    """The graph of the paper's training net: a box is a layer, an arrow a blob; red is what runs backwards."""
    from matplotlib.lines import Line2D

    figure = new_figure(9.0, 8.4)
    axes = figure.add_subplot()
    places: dict[int, Place] = {}  # blob id: the middle of the box that writes it
    columns: dict[int, int] = {}  # blob id: the column of its readers; a Split's second copy is read in the next one
    boxes: dict[Place, int] = {}  # the number of layers at a place: one, and those in place behind it
    row = 0
    for at in train_net().connections:
        if at.top and at.bottom and at.top[0] is at.bottom[0]:
            x, y = place = places[id(at.top[0])]
            _draw_box(axes, at, x + boxes[place] * (WIDTH + 0.1), y)
            boxes[place] += 1
            continue
        above = [places[id(blob)] for blob in at.bottom]
        column = columns[id(at.bottom[0])] if at.bottom else 0
        x, y = place = (column * COLUMN, above[0][1] - STEP if column else -STEP * row)
        row += column == 0
        boxes[place] = 1
        _draw_box(axes, at, x, y)
        for start, down in zip(above, at.propagate_down):
            _draw_arrow(axes, start, place, down)
        for i, blob in enumerate(at.top):
            places[id(blob)], columns[id(blob)] = place, column + (i if at.layer.type == "Split" else 0)
        if at.layer.type != "Split":
            lines = [f"{n}  {'×'.join(map(str, b.shape)) or '1'}" for n, b in zip(at.layer.spec.top, at.top)]
            axes.text(x - WIDTH / 2 - 0.12, y, "\n".join(lines), ha="right", va="center", fontsize=7.5)
    for (x, y), count in boxes.items():
        if count > 1:
            _frame(axes, x, y, count)
    kinds = (("forward", RESTS, "-"), ("backward", RUNS, "-"), ("one blob: layers in place", RESTS, "--"))
    entries = [Line2D([], [], color=colour, ls=style, label=kind) for kind, colour, style in kinds]
    axes.legend(handles=entries, loc="lower center", ncols=3, fontsize=8)
    axes.set(xlim=(-4.2, SIDE + 0.9), ylim=(-row * STEP - 0.3, 0.5), aspect="equal")
    axes.axis("off")
    return figure


def train_net() -> netlib.Net:
    """The paper's training net; its data layer is an Input of the same shapes, because there may be no data."""
    param = load_parameter(ROOT / "prototxt" / "nyu_train_test.prototxt")
    data, *others = (layer for layer in param.layer if not any(rule.phase == "TEST" for rule in layer.include))
    batch = data.blocks["hdf5_data_param"].values("batch_size")[0]
    tree = prototxt.parse(f"""
        name: "{data.name}" type: "Input" top: "{data.top[0]}" top: "{data.top[1]}"
        input_param {{ shape {{ dim: {batch} dim: 1 dim: 128 dim: 128 }} shape {{ dim: {batch} dim: 93 }} }}""")
    given = schema.read(tree, LayerParameter)
    return netlib.Net(schema.changed(param, layer=(given, *others)), netlib.TRAIN, seed=0, engine="plain")


def _draw_box(axes: Any, at: Connection, x: float, y: float) -> None:
    from matplotlib.patches import Rectangle

    colour, fill = (RUNS, PALE_DIFF) if at.needs_backward else (RESTS, PALE_REST)
    corner = (x - WIDTH / 2, y - HEIGHT / 2)
    axes.add_patch(Rectangle(corner, WIDTH, HEIGHT, facecolor=fill, edgecolor=colour, lw=1))
    learned = sum(blob.count for blob in at.layer.blobs)
    kind = "HDF5Data" if at.layer.is_input else at.layer.type
    axes.text(x, y + 0.13, at.layer.name, ha="center", va="center", fontsize=7.5, weight="bold")
    axes.text(x, y - 0.15, kind + (f", {learned:,}" if learned else ""), ha="center", va="center", fontsize=7)


def _frame(axes: Any, x: float, y: float, count: int) -> None:
    """A dashed frame around a layer and those in place that overwrite its blob."""
    from matplotlib.patches import Rectangle

    corner, width = (x - WIDTH / 2 - 0.07, y - HEIGHT / 2 - 0.07), count * (WIDTH + 0.1) + 0.04
    axes.add_patch(Rectangle(corner, width, HEIGHT + 0.14, fill=False, edgecolor=RESTS, lw=0.8, ls="--"))


def _draw_arrow(axes: Any, start: Place, end: Place, down: bool) -> None:
    """An arrow from box to box, at the side if there are boxes between them; also one backwards if ``down``."""
    (x0, y0), (x1, y1) = start, end
    forward = [(x0, y0 - HEIGHT / 2), (x1, y1 + HEIGHT / 2)]
    backward = [(x1 + SHIFTED, y1 + HEIGHT / 2), (x0 + SHIFTED, y0 - HEIGHT / 2)]
    if y0 - y1 > 1.5 * STEP:
        forward = [(x0 + WIDTH / 2, y0), (SIDE, y0), (SIDE, y1), (x1 + WIDTH / 2, y1)]
        backward = [(x + SHIFTED, y + SHIFTED) for x, y in reversed(forward)]
    elif x0 != x1:
        forward = [(x0 + WIDTH / 2, y0), (x1, y0), (x1, y1 + HEIGHT / 2)]
        right = x1 + SHIFTED
        backward = [(right, y1 + HEIGHT / 2), (right, y0 + SHIFTED), (x0 + WIDTH / 2, y0 + SHIFTED)]
    for path, colour in ((forward, RESTS), (backward, RUNS)) if down else ((forward, RESTS),):
        axes.plot(*zip(*path), color=colour, lw=0.9)
        axes.annotate("", path[-1], path[-2], arrowprops={**ARROW, "lw": 0.9, "color": colour})
