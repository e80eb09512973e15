"""Fixtures for tests of pages in a Chromium without network access, whose console must stay empty."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from docs.making.chromium import NoBrowserError, chromium


@contextlib.contextmanager
def browsing() -> Iterator[Any]:
    """A browser for tests that do not fork; skips if there is none."""
    try:
        with chromium() as opened:
            yield opened
    except NoBrowserError as error:
        pytest.skip(str(error))


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    """The browser for a module's pages."""
    with browsing() as opened:
        yield opened


@contextlib.contextmanager
def visits(browser: Any) -> Iterator[Callable[..., Any]]:
    """``visit(path)``: open a page from a file, as from disk, or from an address. In the end, no other address was
    fetched, and the console is empty.
    """
    contexts, fetched, said, files = [], [], [], []

    def opened(place: Path | str, fragment: str = "", **options: Any) -> Any:
        context = browser.new_context(**{"viewport": {"width": 1000, "height": 800}, **options})
        contexts.append(context)
        context.set_default_timeout(120_000)  # reached by a hang only
        tab = context.new_page()
        file = place if isinstance(place, str) else place.as_uri()
        address = file + (f"#{fragment}" if fragment else "")
        files.append(file)
        tab.on("request", lambda request: fetched.append(request.url))
        tab.on("console", lambda message: said.append(message.text))
        tab.on("pageerror", lambda error: said.append(str(error)))
        tab.goto(address)
        return tab

    yield opened
    for context in contexts:
        context.close()
    assert fetched == files
    assert said == []


@pytest.fixture
def visit(browser: Any) -> Iterator[Callable[..., Any]]:
    """``visit(path)``: open a page in its own tab; the options are the browser's."""
    with visits(browser) as opened:
        yield opened
