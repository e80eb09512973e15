"""Figures of chapter 5."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import netlib
from docs.making.figures.drawn import new_figure
from docs.making.palette import DIFF, PALE_DIFF, PALE_REST, PALM
from netlib.engine.plain import Connection
from netlib.files.paths import ROOT
from netlib.proto import prototxt, schema
from netlib.proto.messages import LayerParameter
from netlib.proto.net_parameter import load_parameter

WIDTH, HEIGHT, STEP, COLUMN = 2.3, 0.62, 1.15, 4.6  # of a box; from row to row, from column to column
SIDE, ASIDE = 6.4, 0.2  # where long ways go; how far from the way forward the way back is
RUNS, RESTS = DIFF, PALM  # colours of what runs backwards, and of what does not


def train_test() -> netlib.Net:
    """The paper's training net; its data layer is an Input of the same shapes, since there may be no data."""
    path = ROOT / "prototxt" / "nyu_train_test.prototxt"
    param = load_parameter(path)
    data, *others = (layer for layer in param.layer if not any(rule.phase == "TEST" for rule in layer.include))
    batch = int(str(data.blocks["hdf5_data_param"].values("batch_size")[0]))
    shapes = ((batch, 1, 128, 128), (batch, 93))
    text = " ".join("shape { " + " ".join(f"dim: {n}" for n in shape) + " }" for shape in shapes)
    tops = "".join(f'top: "{name}" ' for name in data.top)
    tree = prototxt.parse(f'name: "{data.name}" type: "Input" {tops} input_param {{ {text} }}')
    given = schema.read(tree, LayerParameter)
    return netlib.Net(schema.changed(param, layer=(given, *others)), netlib.TRAIN, seed=0, engine="plain")


@dataclass
class Row:
    """A layer, and the layers in place behind it, that write the same blobs."""

    at: Connection
    column: int
    in_place: list[Connection] = field(default_factory=list)


def rows_of(net: netlib.Net) -> list[Row]:
    """From top to bottom; what reads the second copy of a Split stands in the next column."""
    rows: list[Row] = []
    column: dict[int, int] = {}  # blob id -> where its readers stand
    writer: dict[int, Row] = {}
    for at in net.connections:
        if at.top and at.bottom and at.top[0] is at.bottom[0]:
            writer[id(at.top[0])].in_place.append(at)
            continue
        row = Row(at, column[id(at.bottom[0])] if at.bottom else 0)
        rows.append(row)
        for i, blob in enumerate(at.top):
            writer[id(blob)] = row
            column[id(blob)] = row.column + (i if at.layer.type == "Split" else 0)
    return rows


def whole_net() -> Any:
    """The graph of the paper's training net: a box is a layer, an arrow a blob; red is what runs backwards."""
    from matplotlib.lines import Line2D

    figure = new_figure(9.0, 8.4)
    axes = figure.add_subplot()
    places: dict[int, tuple[float, float]] = {}  # blob id -> the middle of the box that writes it
    rows = rows_of(train_test())
    line = 0
    for row in rows:
        above = [places[id(blob)] for blob in row.at.bottom]
        y = -STEP * line if row.column == 0 else above[0][1] - STEP
        x = row.column * COLUMN
        line += row.column == 0
        for n, at in enumerate((row.at, *row.in_place)):
            _draw_box(axes, at, x + n * (WIDTH + 0.1), y)
        if row.in_place:
            _frame(axes, x, y, 1 + len(row.in_place))
        for start, down in zip(above, row.at.propagate_down):
            _draw_arrow(axes, start, (x, y), down)
        said = [
            f"{name}  {'×'.join(map(str, blob.shape)) or '1'}" for name, blob in zip(row.at.layer.spec.top, row.at.top)
        ]
        if row.at.layer.type != "Split":
            axes.text(x - WIDTH / 2 - 0.12, y, "\n".join(said), ha="right", va="center", fontsize=7.5)
        places.update((id(blob), (x, y)) for blob in row.at.top)
    ways = (("forward", RESTS, "-"), ("backward", RUNS, "-"), ("one blob: layers in place", RESTS, "--"))
    lines = [Line2D([], [], color=colour, ls=style) for _, colour, style in ways]
    axes.legend(lines, [way for way, _, _ in ways], loc="lower center", ncols=3, fontsize=8)
    axes.set(xlim=(-4.2, SIDE + 0.9), ylim=(-line * STEP - 0.3, 0.5), aspect="equal")
    axes.axis("off")
    return figure


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


def _draw_arrow(axes: Any, start: tuple[float, float], end: tuple[float, float], down: bool) -> None:
    """From box to box; around at the side if there are boxes between them."""
    (x0, y0), (x1, y1) = start, end
    forward = [(x0, y0 - HEIGHT / 2), (x1, y1 + HEIGHT / 2)]
    backward = [(x1 + ASIDE, y1 + HEIGHT / 2), (x0 + ASIDE, y0 - HEIGHT / 2)]
    if y0 - y1 > 1.5 * STEP:
        forward = [(x0 + WIDTH / 2, y0), (SIDE, y0), (SIDE, y1), (x1 + WIDTH / 2, y1)]
        backward = [(x + ASIDE, y + ASIDE) for x, y in reversed(forward)]
    elif x0 != x1:
        forward = [(x0 + WIDTH / 2, y0), (x1, y0), (x1, y1 + HEIGHT / 2)]
        backward = [(x1 + ASIDE, y1 + HEIGHT / 2), (x1 + ASIDE, y0 + ASIDE), (x0 + WIDTH / 2, y0 + ASIDE)]
    _draw_way(axes, forward, RESTS)
    if down:
        _draw_way(axes, backward, RUNS)


def _draw_way(axes: Any, way: list[tuple[float, float]], colour: str) -> None:
    axes.plot(*zip(*way), color=colour, lw=0.9)
    axes.annotate(
        "", way[-1], way[-2], arrowprops={"arrowstyle": "->", "lw": 0.9, "color": colour, "shrinkA": 0, "shrinkB": 0}
    )
