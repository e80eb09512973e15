"""An empty figure, and how a figure becomes a file."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

from docs.making.figures.palette import DARK, DARK_AREAS
from netlib.files import atomic


def new_figure(width: float = 8.0, height: float = 4.0) -> Any:
    """An empty figure, in inches."""
    from matplotlib.figure import Figure

    return Figure(figsize=(width, height), layout="constrained")


def write(figure: Any, path: Path) -> None:
    """Write the figure as SVG. For readers who prefer dark pages, a style replaces the colours of palette.py."""
    import matplotlib

    rules = [f"svg {{fill: {DARK['#000000']}}}"]  # text of matplotlib's default colour has no style attribute
    for name, colours in (("fill", DARK_AREAS), ("stroke", DARK)):
        rules += [f'[style*="{name}: {a}"] {{{name}: {b} !important}}' for a, b in colours.items()]
    style = f"</metadata>\n <style>@media (prefers-color-scheme: dark) {{{' '.join(rules)}}}</style>\n"
    file = io.StringIO()
    with matplotlib.rc_context({"svg.hashsalt": "the book", "svg.image_inline": True}):
        figure.savefig(file, format="svg", metadata={"Date": None, "Creator": None})
    atomic.replace_text(path, file.getvalue().replace("</metadata>\n", style, 1))
