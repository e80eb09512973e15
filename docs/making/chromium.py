"""A Chromium without a window, for the tests of the page and for its picture."""

from __future__ import annotations

import contextlib
import os
import shutil
from collections.abc import Iterator
from typing import TYPE_CHECKING

from netlib.errors import NetlibError, reason_of

if TYPE_CHECKING:
    from playwright.sync_api import Browser

NAMES = ("chromium", "chromium-browser", "google-chrome")
FLAGS = ("--disable-gpu", "--no-first-run", "--disable-background-networking", "--disable-component-update",
         "--disable-sync")  # fmt: skip


class NoBrowserError(NetlibError):
    """There is none on this machine, or nothing to drive it."""


@contextlib.contextmanager
def chromium() -> Iterator[Browser]:
    """The browser, closed at the end. Raises NoBrowserError, or NetlibError for one that does not start."""
    try:
        from playwright.sync_api import Error, sync_playwright
    except ImportError as error:
        raise NoBrowserError("playwright is missing: pip install playwright") from error
    path = next(filter(None, map(shutil.which, NAMES)), None)  # else the one that playwright has brought, if it has
    as_root = ("--no-sandbox",) if hasattr(os, "geteuid") and os.geteuid() == 0 else ()
    with sync_playwright() as driver:
        try:
            browser = driver.chromium.launch(executable_path=path, args=[*FLAGS, *as_root])
        except Error as error:
            if path is None and "Executable doesn't exist" in str(error):
                raise NoBrowserError("no Chromium: install it, or run: playwright install chromium") from error
            raise NetlibError(f"{path or 'Chromium'} does not start: {reason_of(error)}") from error
        with contextlib.closing(browser):
            yield browser
