"""What documents show of the code is what the code is now: ``make docs`` has been run."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from docs.making import __main__ as making
from docs.making.made import ROOT, Made


def files() -> Iterator[Made | ValueError]:
    """All that is made; a document that names what is not there is one test's error, not that of all tests."""
    for piece in making.PIECES:
        try:
            yield from piece()
        except ValueError as error:
            yield error


@pytest.mark.parametrize(
    "made", list(files()), ids=lambda made: str(made.path.relative_to(ROOT)) if isinstance(made, Made) else "error"
)
def test_it_is_current(made: Made | ValueError) -> None:
    """The remedy is one command."""
    if isinstance(made, ValueError):
        raise made
    assert made.is_current(), f"{made.path.relative_to(ROOT)} is not what the code makes of it: run make docs"


def test_a_name_that_is_gone_is_one_line(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    """And the command fails."""

    def piece() -> Iterator[Made]:
        raise ValueError("page.md: box.py has no Box")
        yield

    monkeypatch.setattr(making, "PIECES", (piece,))
    assert making.main() == 1
    assert capsys.readouterr() == ("", "error: page.md: box.py has no Box\n")
