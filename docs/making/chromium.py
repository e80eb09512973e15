"""A Chromium without a window, for the tests of the page and for its picture."""

from __future__ import annotations

import contextlib
import os
import shutil
from collections.abc import Iterator
from typing import TYPE_CHECKING

from netlib.errors import NetlibError

if TYPE_CHECKING:
    from playwright.sync_api import Browser

NAMES = ("chromium", "chromium-browser", "google-chrome")
FLAGS = ("--disable-gpu", "--no-first-run", "--disable-background-networking", "--disable-component-update",
         "--disable-sync")  # fmt: skip


@contextlib.contextmanager
def chromium() -> Iterator[Browser]:
    """The browser, closed at the end. Raises NetlibError, with a line that says what is missing."""
    try:
        from playwright.sync_api import Error, sync_playwright
    except ImportError as error:
        raise NetlibError("playwright is missing: pip install 'deepmodel-numpy[browser]'") from error
    path = next(filter(None, map(shutil.which, NAMES)), None)  # else the one that playwright has brought, if it has
    as_root = ("--no-sandbox",) if hasattr(os, "geteuid") and os.geteuid() == 0 else ()
    with sync_playwright() as driver:
        try:
            browser = driver.chromium.launch(executable_path=path, args=[*FLAGS, *as_root])
        except Error as error:
            reason = str(error).strip().splitlines()[0]
            raise NetlibError(f"no Chromium ({reason}): install chromium, or: playwright install chromium") from error
        with contextlib.closing(browser):
            yield browser
