"""A Chromium without a window, for the tests of pages and for their pictures."""

from __future__ import annotations

import contextlib
import os
import shutil
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from netlib.errors import NetlibError, reason_of
from netlib.files import atomic
from netlib.files.paths import ROOT

if TYPE_CHECKING:
    from playwright.sync_api import Browser

NAMES = ("chromium", "chromium-browser", "google-chrome")
FLAGS = ("--disable-gpu", "--no-first-run", "--disable-background-networking", "--disable-component-update",
         "--disable-sync")


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


def write(picture: Path, taken: Callable[[Browser], bytes]) -> int:
    """Write what ``taken`` returns, a PNG, and print the path; returns the exit status."""
    try:
        with chromium() as browser:
            atomic.replace_bytes(picture, taken(browser))
    except NetlibError as error:
        print(error, file=sys.stderr)
        return 1
    print(f"wrote {picture.relative_to(ROOT)}")
    return 0
