"""Writes the picture of a page, taken in Chromium."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from docs.making.chromium import chromium
from netlib.errors import NetlibError
from netlib.files import atomic
from netlib.files.paths import ROOT

if TYPE_CHECKING:
    from playwright.sync_api import Browser


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
