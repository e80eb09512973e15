"""The colours of the book's figures and pages, an empty figure, and how a figure becomes a file."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

from netlib.files import atomic
from netlib.files.paths import ROOT

PLACE = ROOT / "docs" / "images" / "book"
DATA, DIFF = "#08519c", "#d95f02"  # values and the forward pass; gradients and the backward pass
PALE_DATA, PALE_DIFF = "#dbe9f6", "#fde3cf"
REST, PALE_REST = "#636363", "#eeeeee"  # everything else
FORCE = DIFF  # a force is a gradient
POSITIVE, NEGATIVE = "#b2182b", "#2166ac"  # the ends of SIGNS
SIGNS = "RdBu_r"  # the colour map of signed numbers
DEPTH = "gray_r"  # the colour map of depth: near is bright
FIRST, SECOND, THIRD, FOURTH = DATA, DIFF, "#117733", "#882299"  # curves and parts, in this order
LINE, INK = "#999999", "#222222"
AXES = ("#cc3311", "#117733", "#2166ac")  # x, y, z of a frame
FINGERS = {
    "thumb": "#cc3311",
    "index": "#dd7700",
    "middle": "#117733",
    "ring": "#2166ac",
    "little": "#882299",
}
PALM = "#555555"
# The same colours on a dark page, of lines and letters, and of areas; docs/book/pages/common.css
# repeats some of them.
DARK = {
    "#000000": "#e7eaf0",
    INK: "#e7eaf0",
    DATA: "#7fb2f0",
    DIFF: "#f0954d",
    NEGATIVE: "#7fb2f0",
    THIRD: "#4fb06d",
    FOURTH: "#c583d8",
    REST: "#98a2b3",
    PALM: "#b4bac4",
    FINGERS["thumb"]: "#f0705a",
}
DARK_AREAS = {
    **DARK,
    "#ffffff": "#1c2027",
    PALE_DATA: "#20344d",
    PALE_DIFF: "#4a2f1c",
    PALE_REST: "#2a2f38",
    "#ededed": "#2a2f38",
}


def new_figure(width: float, height: float) -> Any:
    """An empty figure, in inches."""
    from matplotlib.figure import Figure

    return Figure(figsize=(width, height), layout="constrained")


def write(figure: Any, path: Path) -> None:
    """Write the figure as SVG.

    For readers who prefer dark pages, a style replaces the colours above.
    """
    import matplotlib

    # text of matplotlib's default colour has no style attribute
    rules = [f"svg {{fill: {DARK['#000000']}}}"]
    for name, colours in (("fill", DARK_AREAS), ("stroke", DARK)):
        rules += [f'[style*="{name}: {a}"] {{{name}: {b} !important}}' for a, b in colours.items()]
    style = (
        f"</metadata>\n <style>@media (prefers-color-scheme: dark) {{{' '.join(rules)}}}</style>\n"
    )
    file = io.StringIO()
    with matplotlib.rc_context({"svg.hashsalt": "the book", "svg.image_inline": True}):
        figure.savefig(file, format="svg", metadata={"Date": None, "Creator": None})
    atomic.replace_text(path, file.getvalue().replace("</metadata>\n", style, 1))
