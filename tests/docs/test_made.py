"""What documents show of the code is what the code is now: ``make docs`` has been run."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from docs.making import __main__ as making
from docs.making.made import Made
from netlib.paths import ROOT

FILES = [made for piece in making.PIECES for made in piece()]


@pytest.mark.parametrize("made", FILES, ids=lambda made: str(made.path.relative_to(ROOT)))
def test_it_is_current(made: Made) -> None:
    """The remedy is one command."""
    assert made.is_current(), f"{made.path.relative_to(ROOT)} is not what the code makes of it: run make docs"


def test_a_name_that_is_gone_is_one_line(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    """And the command fails."""

    def gone() -> bytes:
        raise ValueError("page.md: box.py has no Box")

    def piece() -> Iterator[Made]:
        yield Made(ROOT / "page.md", gone)

    monkeypatch.setattr(making, "PIECES", (piece,))
    assert making.main() == 1
    assert capsys.readouterr() == ("", "error: page.md: box.py has no Box\n")
