"""The text of every document, with all in it that comes from the code: one change after the other."""

from __future__ import annotations

import functools
import re
from collections.abc import Callable, Iterator
from pathlib import Path

from docs.making import code_blocks, exercises, line_links
from docs.making.made import ROOT, Made

# What tells that a document has something to be made, and the change that makes it: (text, document) -> text.
CHANGES: tuple[tuple[re.Pattern[str], Callable[[str, Path], str]], ...] = (
    (code_blocks.MARK, code_blocks.current),
    (exercises.MARK, exercises.current),
    (line_links.MARK, line_links.current),
)


def made() -> Iterator[Made]:
    """Every document of the project in which something is made."""
    for path in sorted([*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md")]):
        text = path.read_text(encoding="utf-8")
        if any(mark.search(text) for mark, _ in CHANGES):
            yield Made(path, functools.partial(_wanted, path))


def _wanted(path: Path) -> bytes:
    return current(path.read_text(encoding="utf-8"), path).encode()


def current(text: str, path: Path) -> str:
    """The text of the document at ``path`` as it has to be now. Raises ValueError if it names what is not there."""
    for _, change in CHANGES:
        text = change(text, path)
    return text
