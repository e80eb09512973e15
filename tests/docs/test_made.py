"""The generated parts of documents that are in git are up to date: ``make docs`` has been run."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from docs.making import __main__ as making
from docs.making.made import Made
from netlib.files.paths import ROOT
from tests.support.running import run_tool

FILES = [made for name, piece in making.PIECES.items() if name not in making.BUILT for made in piece()]


@pytest.mark.parametrize("made", FILES, ids=lambda made: str(made.path.relative_to(ROOT)))
def test_it_is_current(made: Made) -> None:
    """Each generated file is up to date."""
    assert made.is_current(), f"{made.path.relative_to(ROOT)} is not what the code makes of it: run make docs"


def test_a_name_that_is_gone_is_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    """A name that does not exist gives a one-line error and status 1."""

    def gone() -> bytes:
        raise ValueError("page.md: box.py has no Box")

    def piece() -> Iterator[Made]:
        yield Made(ROOT / "page.md", gone)

    monkeypatch.setattr(making, "PIECES", {"page": piece})
    assert run_tool("docs.making.__main__", status=1)[1:] == ("", "error: page.md: box.py has no Box\n")


def test_what_is_not_current(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Outdated files are reported and kept with --check, and written without it; other parts are not touched."""
    page = tmp_path / "page.md"
    page.write_text("old")
    monkeypatch.setattr(making, "ROOT", tmp_path)
    monkeypatch.setattr(making, "PIECES", {"page": lambda: [Made(page, lambda: b"new")], "other": lambda: 1 / 0})
    done = run_tool("docs.making.__main__", "--check", "page", status=1)
    assert (page.read_text(), done.err) == ("old", "not current: page.md; run make docs\n")
    done = run_tool("docs.making.__main__", "page")
    assert (page.read_text(), done.out) == ("new", "wrote page.md\n")
    run_tool("docs.making.__main__", "--check", "page")


def test_a_part_that_does_not_exist() -> None:
    """An unknown part is a usage error."""
    done = run_tool("docs.making.__main__", "exercise", status=2)
    assert "no part exercise; expected some of documents, figures" in done.err
