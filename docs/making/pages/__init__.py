"""Pages of the book for the browser, one self-contained file each: docs/windows.html, small_net.html.

The numbers that a page shows are computed here, by the code that the book is about. The sources of the pages are in
docs/book/pages; they are assembled as the page of the hand is.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterator
from typing import Any

from docs.making import palette
from docs.making.made import Made
from docs.making.pages import small_net, windows
from handpose.output.hand_page.assembly import assembled, script_of, source
from netlib.files.paths import ROOT

BROWSER = ROOT / "docs" / "book" / "pages"


PAGES: dict[str, tuple[str, Callable[[], dict[str, Any]]]] = {  # name of the file: (title, a function of its data)
    "windows": ("Convolution and pooling", windows.data),
    "small_net": ("A small net, step by step", small_net.data),
}


def made() -> Iterator[Made]:
    """Every page."""
    for name in PAGES:
        yield Made(ROOT / "docs" / f"{name}.html", functools.partial(_page, name))


def _page(name: str) -> bytes:
    title, data = PAGES[name]
    colours = "".join(f"--{key.lower().replace('_', '-')}: {value}; " for key, value in _colours().items())
    style = f":root {{ {colours}}}\n" + source("common.css", BROWSER)
    body = "<h1>$title</h1>\n" + source(f"{name}.html", BROWSER)
    return assembled(title, data(), body, style, script_of(name, BROWSER)).encode()


def _colours() -> dict[str, str]:
    names = ("DATA", "DIFF", "PALE_DATA", "PALE_DIFF", "REST", "PALE_REST", "POSITIVE", "NEGATIVE")
    return {name: getattr(palette, name) for name in names}
