"""Fixtures for tests of pages in a Chromium without network access, whose console
must stay empty.
"""

from __future__ import annotations

import base64
import contextlib
import os
import shutil
import weakref
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

CHROMIUM = ("chromium", "chromium-browser", "google-chrome")
FLAGS = (
    "--disable-gpu",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
)


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    """A browser without a window for a module's pages, for tests that do not fork; skips if
    there is none.
    """
    sync_api = pytest.importorskip(
        "playwright.sync_api", reason="tests of pages need: pip install -e '.[test]'"
    )
    path = next(filter(None, map(shutil.which, CHROMIUM)), None)
    as_root = ("--no-sandbox",) if hasattr(os, "geteuid") and os.geteuid() == 0 else ()
    with sync_api.sync_playwright() as driver:
        if path is None and not Path(driver.chromium.executable_path).is_file():
            pytest.skip("no Chromium: install it, or run: playwright install chromium")
        with contextlib.closing(
            driver.chromium.launch(executable_path=path, args=[*FLAGS, *as_root])
        ) as opened:
            yield opened


SIZE = {"width": 1000, "height": 800}
# tabs by browser; a new one costs 0.4 s
_idle: weakref.WeakKeyDictionary[Any, list[Any]] = weakref.WeakKeyDictionary()


@contextlib.contextmanager
def visits(browser: Any) -> Iterator[Callable[..., Any]]:
    """``visit(path)``: open a page from a file, as from disk, or from an address.

    In the end, no other address was fetched, and the console is empty.

    A tab that differs from others by its size only shows one page after the other.
    """
    contexts, shared, fetched, said, files = [], [], [], [], []
    watched: dict[str, Callable[[Any], None]] = {
        "request": lambda request: fetched.append(request.url),
        "console": lambda message: said.append(message.text),
        "pageerror": lambda error: said.append(str(error)),
    }

    def new(**options: Any) -> Any:
        context = browser.new_context(**options)
        context.set_default_timeout(120_000)  # reached by a hang only
        return context.new_page()

    def opened(place: Path | str, fragment: str = "", **options: Any) -> Any:
        size = options.pop("viewport", SIZE)
        if options:
            tab = new(viewport=size, **options)
            contexts.append(tab.context)
        else:
            idle = _idle.setdefault(browser, [])
            tab = idle.pop() if idle else new(viewport=SIZE)
            shared.append(tab)
            tab.set_viewport_size(size)
        file = place if isinstance(place, str) else place.as_uri()
        address = file + (f"#{fragment}" if fragment else "")
        files.append(file)
        for event, hear in watched.items():
            tab.on(event, hear)
        tab.goto(address)
        return tab

    yield opened
    for context in contexts:
        context.close()
    for tab in (tab for tab in shared if not tab.is_closed()):
        for event, hear in watched.items():
            tab.remove_listener(event, hear)
        tab.mouse.up()
        tab.mouse.move(-1, -1)  # over no element of the next page
        tab.evaluate("if (location.protocol !== 'file:') sessionStorage.clear()")
        tab.goto("about:blank")
        _idle[browser].append(tab)
    assert fetched == files
    assert said == []


@pytest.fixture
def visit(browser: Any) -> Iterator[Callable[..., Any]]:
    """``visit(path)``: open a page in its own tab; the options are the browser's."""
    with visits(browser) as opened:
        yield opened


def picture(tab: Any, canvas: str, draw: str = "null") -> np.ndarray:
    """The pixels (height, width, 4) of a canvas: red, green, blue, opacity.

    ``draw`` is evaluated immediately before, so that the page does not draw in between.
    """
    png = tab.evaluate(f"({draw}, document.getElementById('{canvas}').toDataURL())").partition(",")[
        2
    ]
    pixels = cv2.imdecode(np.frombuffer(base64.b64decode(png), np.uint8), cv2.IMREAD_UNCHANGED)
    return pixels[..., [2, 1, 0, 3]]
