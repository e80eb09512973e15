"""Diagrams of chapters 1 to 5 and 7 to 9, drawn from the numbers of the chapters."""

from __future__ import annotations

from typing import Any

import numpy as np

from docs.making.figures.drawing import (
    AXES,
    DATA,
    DIFF,
    FIRST,
    FOURTH,
    INK,
    LINE,
    PALE_REST,
    SECOND,
    THIRD,
    new_figure,
)
from layers.hand.kinematics import rotation
from netlib.blob import Array

IMAGE = np.array([[1, 2, 0, 1], [0, 1, 3, 1], [2, 0, 1, 0], [1, 1, 0, 2]])  # of chapter 3
KERNEL = np.array([[1, 2], [0, -1]])
CENTERED: dict[str, Any] = {"ha": "center", "va": "center"}
Point = tuple[float, float]


def _canvas(inches: Point, size: Point) -> tuple[Any, Any]:
    """A figure and its axes, which are not drawn; ``size`` is the range of x and y."""
    figure = new_figure(*inches)
    axes = figure.add_subplot()
    axes.set(xlim=(0, size[0]), ylim=(0, size[1]), aspect="equal")
    axes.axis("off")
    return figure, axes


def _text(axes: Any, x: float, y: float, words: str, **style: Any) -> None:
    """Words to the right of (x, y), unless the style is another."""
    axes.text(x, y, words, **{"fontsize": 9, **style})


def _box(axes: Any, x: float, y: float, words: str, width: float, colour: str = PALE_REST) -> None:
    """A box of this width around words; (x, y) is its middle."""
    from matplotlib.patches import FancyBboxPatch

    corner = (x - width / 2, y - 0.32)
    box = FancyBboxPatch(corner, width, 0.64, boxstyle="round,pad=0.05", fc=colour, ec=LINE)
    axes.add_patch(box)
    _text(axes, x, y, words, **CENTERED)


def _arrow(axes: Any, start: Point, end: Point, colour: str = INK) -> None:
    axes.annotate("", end, start, arrowprops={"arrowstyle": "->", "color": colour, "lw": 1.2})


def _wire(axes: Any, start: Point, end: Point, value: str, gradient: str, side: int = 0) -> None:
    """An arrow with its value above and its gradient below; both above (1) or below (-1) one
    that is not level.
    """
    _arrow(axes, start, end)
    (x0, y0), (x1, y1) = start, end
    x, y = (x0 + x1) / 2, (y0 + y1) / 2
    is_steep = abs(y1 - y0) > 1
    if is_steep:
        x, y = x - 0.7, y + side * 0.85
    else:
        y += side * 0.55
    for words, colour, above in ((value, DATA, 0.22), (gradient, DIFF, -0.22)):
        _text(axes, x, y + above, words, color=colour, **CENTERED)


def _grid(
    axes: Any, x: float, y: float, numbers: Array, shade: Array | str = "", size: float = 0.7
) -> None:
    """A matrix as squares; ``shade`` is the colour of all or of each, or "" for none. (x, y) is
    the upper left corner.
    """
    from matplotlib.patches import Rectangle

    shades = np.broadcast_to(shade, numbers.shape)
    for (row, column), number in np.ndenumerate(numbers):
        left, bottom = x + column * size, y - (row + 1) * size
        colour = shades[row, column] or "white"
        opacity = 0.55 if colour != "white" else 1
        square = Rectangle((left, bottom), size, size, fc=colour, ec=LINE, alpha=opacity)
        axes.add_patch(square)
        _text(axes, left + size / 2, bottom + size / 2, f"{number:g}", **CENTERED)


def circuit() -> Any:
    """Chapter 1's chain: a = w x, y = max(a, 0), L = ½ (y − t)², with x = 2, w = 3, t = 5."""
    x, w, t = 2.0, 3.0, 5.0
    a = w * x
    y = max(a, 0.0)
    loss = 0.5 * (y - t) ** 2
    dy = y - t
    da = dy * (a > 0)
    dx, dw = da * w, da * x
    figure, axes = _canvas((8.0, 2.4), (11.2, 3.2))
    level = 1.6  # of the chain
    for middle, words in (
        (2.6, "weigh: a = w x"),
        (5.8, "cut: max(a, 0)"),
        (9.0, "compare: ½ (y − t)²"),
    ):
        _box(axes, middle, level, words, 2.0)
    _wire(axes, (0.1, 2.4), (1.5, 1.8), f"x = {x:g}", f"dx = {dx:g}", 1)
    _wire(axes, (0.1, 0.8), (1.5, 1.4), f"w = {w:g}", f"dw = {dw:g}", -1)
    _wire(axes, (3.7, level), (4.7, level), f"a = {a:g}", f"da = {da:g}")
    _wire(axes, (6.9, level), (7.9, level), f"y = {y:g}", f"dy = {dy:g}")
    _wire(axes, (10.1, level), (11.1, level), f"L = {loss:g}", "dL = 1")
    axes.set_title("forward: values, in blue; backward: gradients, in orange", fontsize=10)
    return figure


def outer() -> Any:
    """Chapter 2's dw: for each item, its column of dy times its row of x."""
    x = np.array([[1.0, 2, 0], [0, -1, 1]])
    dy = np.array([[1.0, 0], [2, -1]])
    figure, axes = _canvas((8.5, 2.5), (15.2, 4.0))
    column_top, row_top, caption = 2.4, 3.4, 0.5
    for n, colour in enumerate((FIRST, SECOND)):
        left = 0.2 + 4.6 * n
        product = left + 1.1
        _grid(axes, left, column_top, dy[n][:, None], colour)
        _grid(axes, product, row_top, x[n][None], colour)
        _grid(axes, product, column_top, np.outer(dy[n], x[n]) + 0)
        words = f"dy[{n}] as a column, x[{n}] as a row"
        _text(axes, left, caption, words, fontsize=8.5, color=INK)
        _text(axes, left + 3.6, 1.65, "+" if n == 0 else "=", fontsize=14, **CENTERED)
    total = 9.4
    _grid(axes, total, column_top, dy.T @ x)
    _text(axes, total, caption, "dw = dyᵀ x")
    return figure


def window() -> Any:
    """Chapter 3: a window and its number; a number of dy and its stamp."""
    figure, axes = _canvas((8.5, 3.3), (14.4, 4.6))
    shade = np.full((4, 4), "", object)
    shade[1:3, 2:4] = FIRST
    output_shade = np.full((3, 3), "", object)
    output_shade[1, 2] = FIRST
    windows = np.lib.stride_tricks.sliding_window_view(IMAGE, KERNEL.shape)
    y = (windows * KERNEL).sum(axis=(2, 3)) + 1
    dy = np.array([[1, 0, 0], [0, 0, 2], [0, -1, 0]])
    stamp = np.zeros((4, 4))
    stamp[1:3, 2:4] = dy[1, 2] * KERNEL
    title, caption = 4.15, 0.4
    forward, backward = 0.1, 8.4
    _grid(axes, forward, 3.9, IMAGE, shade)
    _grid(axes, 3.3, 3.2, KERNEL, SECOND)
    _grid(axes, 5.2, 3.6, y, output_shade)
    _text(axes, forward, title, "forward: x, kernel, y")
    _text(axes, forward, caption, "window × kernel, summed, + 1 = 6")
    _grid(axes, backward, 3.6, dy, output_shade)
    _grid(axes, 11.3, 3.9, stamp, np.where(shade == "", "", SECOND))
    _text(axes, backward, title, "backward: dy, its stamp on dx")
    _text(axes, backward, caption, "2 × kernel, added where the window was")
    return figure


def im2col() -> Any:
    """Chapter 3: the columns of a 4 × 4 image for a kernel of 2 × 2; four pixels in colour."""
    figure, axes = _canvas((8.5, 3.0), (12.6, 4.4))
    shade = np.full((4, 4), "", object)
    shade[[0, 1, 1, 2], [0, 1, 2, 3]] = FIRST, SECOND, THIRD, FOURTH
    columns = np.zeros((4, 9))
    colours = np.full((4, 9), "", object)
    for row, (i, j) in enumerate(np.ndindex(2, 2)):
        factors = np.s_[i : i + 3, j : j + 3]  # the pixels that w[i, j] is multiplied by
        columns[row] = IMAGE[factors].ravel()
        colours[row] = shade[factors].ravel()
        middle = 3.35 - 0.7 * row
        _text(axes, 5.45, middle, f"times w[{i}, {j}]", ha="right", va="center", fontsize=8.5)
    for left, numbers, shading, title in (
        (0.1, IMAGE, shade, "x"),
        (5.6, columns, colours, "a column for each of the nine windows"),
    ):
        _grid(axes, left, 3.7, numbers, shading)
        _text(axes, left, 4.0, title)
    return figure


def winners() -> Any:
    """Chapter 4: windows of 2 × 2 on 5 × 5, their winners, and where dy = 1 … 9 goes."""
    x = np.array(
        [[0.0, 0, 3, 1, 2], [0, 0, 1, 4, 2], [5, 1, 0, 0, 0], [2, 6, 0, 0, 7], [1, 1, 2, 2, 9]]
    )
    shade = np.full((5, 5), "", object)
    dx = np.zeros((5, 5))
    for dy, (i, j) in enumerate(np.ndindex(3, 3), 1):
        top, left = 2 * i, 2 * j
        part = x[top : top + 2, left : left + 2]
        row, column = np.unravel_index(part.argmax(), part.shape)
        winner = top + int(row), left + int(column)
        shade[winner] = SECOND
        dx[winner] = dy
    figure, axes = _canvas((7.0, 3.2), (9.6, 4.4))
    upper = 3.7  # edge of both grids; the lower one is at 0.2
    for left, numbers, title in (
        (0.2, x, "x: winners in orange"),
        (5.2, dx, "dx: dy at the winners, 0 elsewhere"),
    ):
        _grid(axes, left, upper, numbers, shade)
        _text(axes, left, upper + 0.25, title)
        for offset in (1.4, 2.8):  # between the windows
            axes.plot([left + offset, left + offset], [0.2, upper], color=INK, lw=2)
            axes.plot([left, left + 3.5], [upper - offset, upper - offset], color=INK, lw=2)
    return figure


def small_pass() -> Any:
    """Chapter 5: the small net with x = 2 and t = 1; each wire with its value and its gradient."""
    figure, axes = _canvas((9.5, 3.8), (17.0, 6.0))
    boxes = {
        "first": (2.6, 3),
        "second": (5.4, 3),
        "relu": (8.4, 3),
        "Split": (11.2, 3),
        "out": (14.0, 5.2),
        "mean": (14.0, 3),
        "size": (14.0, 0.8),
        "loss": (16.2, 5.2),
    }
    for name, (x, y) in boxes.items():
        _box(axes, x, y, name, 1.1, PALE_REST if name not in ("first", "mean") else "white")

    def wire(writer: str, reader: str, value: str, gradient: str, side: int = 0) -> None:
        """A wire between two boxes, with the arguments of ``_wire``."""
        (x0, y0), (x1, y1) = boxes[writer], boxes[reader]
        start = (x0 + 0.7, y0 + 0.2 * side)
        _wire(axes, start, (x1 - 0.7, y1 - 0.3 * side), value, gradient, side)

    _wire(axes, (0.2, 3), (1.9, 3), "x = 2", "–")
    wire("first", "second", "a = 3", "–")
    wire("second", "relu", "h = [3 −2]", "[1.75 0]")
    wire("relu", "Split", "[3 0]", "[1.75 0.5]")
    wire("Split", "out", "[3 0]", "[0.25 0.5]", 1)
    wire("Split", "mean", "[3 0]", "0")
    wire("Split", "size", "[3 0]", "[1.5 0]", -1)
    wire("out", "loss", "1.5", "0.5")
    _text(axes, 14.8, 0.8, "9", color=DATA, va="bottom")
    _text(axes, 14.8, 0.8, "0.25", color=DIFF, va="top")
    _text(axes, 16.2, 4.6, "0.125", color=DATA, va="top", ha="center")
    _text(axes, 0.2, 5.4, "white boxes do not run backwards")
    return figure


def dropout() -> Any:
    """Chapter 7: a mask with p = ½ on four values, and on the gradients that come back."""
    x = np.array([[3, 5, 7, 9]])
    keep = np.array([[1, 0, 0, 1]])
    dy = np.array([[1, 2, 3, 4]])
    figure, axes = _canvas((7.5, 2.2), (13.0, 3.2))
    factors = 2 * keep
    left, middle, right = 0.2, 3.4, 6.6
    forward = ((left, x, "x"), (middle, factors, "keep / (1 − p)"), (right, factors * x, "y"))
    backward = (
        (right, dy, "dy"),
        (middle, factors, "the same factors"),
        (left, factors * dy, "dx"),
    )
    for row, top, caption, colour, direction in (
        (forward, 2.6, 2.75, DATA, "forward →"),
        (backward, 1.2, 0.1, DIFF, "← backward"),
    ):
        kept = np.where(keep > 0, colour, "")
        for n, (place, numbers, words) in enumerate(row):
            _grid(axes, place, top, numbers, kept if n > 0 else "")
            _text(axes, place, caption, words, color=colour)
        _text(axes, 9.8, top - 0.35, direction, color=colour, va="center")
    return figure


def rotations() -> Any:
    """Chapter 8: a palm with fingers along y, rotated by quarter turns about x and z
    in two orders.
    """
    x = rotation(0, np.pi / 2)
    z = rotation(2, np.pi / 2)
    away = np.array([0.45, 0.35])  # how z, away from the viewer, is drawn
    figure = new_figure(8.5, 3.0)
    turns = (
        ("not rotated", np.eye(3)),
        ("R_z R_x: points away", z @ x),
        ("R_x R_z: points left", x @ z),
    )
    for n, (title, turn) in enumerate(turns, 1):
        axes = figure.add_subplot(1, 3, n)
        axes.set(xlim=(-1.3, 1.3), ylim=(-0.9, 1.3), aspect="equal", title=title)
        axes.axis("off")
        for axis, name, colour in zip(np.eye(3), "xyz", AXES):
            tip = 0.8 * (axis[:2] + axis[2] * away)
            axes.plot([0, tip[0]], [0, tip[1]], ":", color=colour, lw=1)
            axes.text(*(1.15 * tip), name, color=colour, fontsize=9, **CENTERED)
        for offset, length in ((-0.24, 0.75), (-0.08, 0.75), (0.08, 0.75), (0.24, 0.6)):
            finger = np.array([[offset, 0, 0], [offset, length, 0]]) @ turn.T
            drawn = finger[:, :2] + finger[:, 2:] * away
            axes.plot(*drawn.T, color=INK, lw=4, solid_capstyle="round", alpha=0.75)
    return figure


def torque_box() -> Any:
    """Chapter 9: the edges a, r and f of a box, whose volume is the gradient of the angle."""
    figure, axes = _canvas((5.0, 3.4), (6.0, 4.2))
    origin = np.array([0.8, 0.5])
    a, r, f = np.array([0.0, 2.2]), np.array([2.8, 0.35]), np.array([1.0, 0.95])
    for edge, one, other in ((a, r, f), (r, a, f), (f, a, r)):
        for start in (one, other, one + other):
            axes.plot(*np.array([origin + start, origin + start + edge]).T, color=LINE, lw=0.8)
    for edge, words, colour in (
        (a, "a: the axis", AXES[2]),
        (r, "r: the lever X − P", INK),
        (f, "f = dL/dX", DIFF),
    ):
        _arrow(axes, tuple(origin), tuple(origin + edge), colour)
        axes.text(*(origin + 1.04 * edge + 0.05), words, color=colour, fontsize=9)
    axes.set_title("f · (a × r) = a · (r × f): the volume of the box", fontsize=10)
    return figure
