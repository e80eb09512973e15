"""docs/making/chromium.py and the pictures of both pages."""

from __future__ import annotations

import os
import sys
from pathlib import Path
from types import ModuleType

import cv2
import numpy as np
import pytest

from docs.making import hand_picture, live_picture
from docs.making.chromium import NoBrowserError, chromium
from netlib.errors import NetlibError

LARGEST = 200_000  # bytes
PAGES = [hand_picture, live_picture]


@pytest.mark.parametrize("page", PAGES)
def test_the_picture_of_the_documents(page: ModuleType) -> None:
    """The picture exists, is a small file of the declared size, and is not empty."""
    raw = page.PICTURE.read_bytes()
    image = cv2.imdecode(np.frombuffer(raw, np.uint8), cv2.IMREAD_COLOR)
    assert len(raw) < LARGEST and image.shape == (page.SIZE["height"], page.SIZE["width"], 3)
    assert len(np.unique(image.reshape(-1, 3), axis=0)) > 1000


@pytest.mark.parametrize("page", PAGES)
def test_without_a_browser(
    page: ModuleType, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Without a browser, one line names the missing program, and the picture is kept."""

    def none() -> object:
        raise NetlibError("no Chromium: install it")

    monkeypatch.setattr("docs.making.chromium.chromium", none)
    before = page.PICTURE.read_bytes()
    assert page.main() == 1 and capsys.readouterr().err == "no Chromium: install it\n"
    assert page.PICTURE.read_bytes() == before


def test_without_playwright(monkeypatch: pytest.MonkeyPatch) -> None:
    """Without playwright, the error has the command that installs it."""
    monkeypatch.setitem(sys.modules, "playwright.sync_api", None)
    with pytest.raises(NoBrowserError, match=r"playwright is missing: pip install playwright"), chromium():
        pass


def test_a_browser_that_does_not_start(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A browser that does not start is an error of its own, so that tests fail instead of being skipped."""
    pytest.importorskip("playwright")
    (tmp_path / "chromium").write_text("#!/bin/sh\nexit 3\n")
    (tmp_path / "chromium").chmod(0o755)
    monkeypatch.setenv("PATH", str(tmp_path), prepend=os.pathsep)
    with pytest.raises(NetlibError, match=r"chromium does not start: ") as refused, chromium():
        pass
    assert not isinstance(refused.value, NoBrowserError) and "\n" not in str(refused.value)
