"""What documents show of the code is what the code is now: ``make docs`` has been run."""

from __future__ import annotations

import pytest

from docs.making.__main__ import PIECES
from docs.making.made import ROOT, Made

FILES = [made for piece in PIECES for made in piece()]


@pytest.mark.parametrize("made", FILES, ids=lambda made: str(made.path.relative_to(ROOT)))
def test_it_is_current(made: Made) -> None:
    """The remedy is one command."""
    assert made.is_current(), f"{made.path.relative_to(ROOT)} is not what the code makes of it: run make docs"
