"""A matplotlib figure as SVG that says what it shows, so that two versions of matplotlib can be compared.

Where the reader prefers dark pages, the figure has dark colours: a style in the file replaces those of palette.py.

The values and words of all artists stand in the file's metadata as JSON. Two figures are the same if the words are
equal and the values agree to a thousandth: lines, patches, points and images, in data coordinates.
"""

from __future__ import annotations

import html
import io
import json
import re
from collections.abc import Iterator
from typing import Any

import numpy as np

from docs.making.palette import DARK, DARK_AREAS

DIGITS = 5
CLOSE = 1e-3  # of the largest value of an artist
IMAGE_CELLS = 24  # along each side: what is kept of an image


def new_figure(width: float = 8.0, height: float = 4.0) -> Any:
    """An empty figure, in inches."""
    from matplotlib.figure import Figure

    return Figure(figsize=(width, height), layout="constrained")


def as_svg(figure: Any) -> bytes:
    """The file."""
    import matplotlib

    said = json.dumps(list(_told(figure)), separators=(",", ":"))
    file = io.BytesIO()
    with matplotlib.rc_context({"svg.hashsalt": "the book", "svg.image_inline": True}):
        figure.savefig(file, format="svg", metadata={"Date": None, "Creator": None, "Description": said})
    return _with_dark(file.getvalue())


def _with_dark(svg: bytes) -> bytes:
    """The file with a style for dark pages. Text of matplotlib's default colour has no style attribute."""
    rules = [f"svg {{fill: {DARK['#000000']}}}"]
    for name, colours in (("fill", DARK_AREAS), ("stroke", DARK)):
        rules += [f'[style*="{name}: {a}"] {{{name}: {b} !important}}' for a, b in colours.items()]
    style = f"<style>@media (prefers-color-scheme: dark) {{{' '.join(rules)}}}</style>"
    return svg.replace(b"</metadata>", b"</metadata>\n " + style.encode(), 1)


def shows_the_same(there: bytes, wanted: bytes) -> bool:
    """Whether two files show the same values and words."""
    a, b = _said(there), _said(wanted)
    return a is not None and b is not None and len(a) == len(b) and all(_alike(x, y) for x, y in zip(a, b))


def _said(svg: bytes) -> list[dict[str, Any]] | None:
    found = re.search(r"<dc:description>(.*?)</dc:description>", svg.decode(), re.DOTALL)
    return json.loads(html.unescape(found[1])) if found else None


def _alike(a: dict[str, Any], b: dict[str, Any]) -> bool:
    x, y = np.array(a["values"], dtype=float), np.array(b["values"], dtype=float)
    if (a["kind"], a["words"], x.shape) != (b["kind"], b["words"], y.shape):
        return False
    return x.size == 0 or bool(np.allclose(x, y, rtol=0, atol=CLOSE * max(1e-12, np.nanmax(np.abs(y))), equal_nan=True))


def _told(figure: Any) -> Iterator[dict[str, Any]]:
    from matplotlib.collections import Collection
    from matplotlib.image import AxesImage
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch
    from matplotlib.text import Text

    for text in figure.texts:
        yield {"kind": "Text", "words": text.get_text(), "values": []}
    for axes in figure.axes:
        for artist in axes.get_children():
            if artist is axes.patch:
                continue
            words = ""
            values: Any = np.zeros(0)
            if isinstance(artist, Text):
                words = artist.get_text()
            elif isinstance(artist, Line2D):
                values = np.asarray(artist.get_data_3d() if hasattr(artist, "get_data_3d") else artist.get_xydata())
            elif isinstance(artist, Patch):
                values = artist.get_path().vertices
            elif isinstance(artist, Collection):
                parts = [np.asarray(artist.get_offsets()), *(path.vertices for path in artist.get_paths())]
                values = np.concatenate([np.ravel(part) for part in parts])
            elif isinstance(artist, AxesImage):
                values = _cells(artist.get_array())
            else:
                continue
            if words or values.size:
                rounded = [float(f"{v:.{DIGITS}g}") for v in np.ravel(np.ma.filled(values, np.nan)).astype(float)]
                yield {"kind": type(artist).__name__, "words": words, "values": rounded}
        yield {
            "kind": "labels",
            "words": f"{axes.get_xlabel()} | {axes.get_ylabel()} | {axes.get_title()}",
            "values": [],
        }


def _cells(image: Any) -> np.ndarray[Any, Any]:
    """Every n-th pixel."""
    pixels = np.asarray(image, dtype=float)
    step = [max(1, n // IMAGE_CELLS) for n in pixels.shape[:2]]
    return pixels[:: step[0], :: step[1]]
