"""The text of every document, with all in it that comes from the code: one change after the other."""

from __future__ import annotations

import functools
import re
from collections.abc import Callable, Iterator
from pathlib import Path

from docs.making import code_blocks, exercises, joint_table, line_links
from docs.making.made import Made
from netlib.errors import reason_of
from netlib.files.paths import ROOT

# The pattern of documents with generated content, and the change that makes it: (text, document) -> text.
CHANGES: tuple[tuple[re.Pattern[str], Callable[[str, Path], str]], ...] = (
    (code_blocks.MARK, code_blocks.current),
    (exercises.MARK, exercises.current),
    (joint_table.MARK, joint_table.current),
    (line_links.MARK, line_links.current),
)


def made() -> Iterator[Made]:
    """Every document of the project in which something is made."""
    for path in sorted([*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md")]):
        if path.is_dir():
            continue
        text = _text_of(path)
        if any(mark.search(text) for mark, _ in CHANGES):
            yield Made(path, functools.partial(_wanted, path))


def _wanted(path: Path) -> bytes:
    return current(_text_of(path), path).encode()


def _text_of(path: Path) -> str:
    """The text of a document. Raises ValueError if it cannot be read."""
    try:
        return path.read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        what = f"not UTF-8 (byte {error.start})" if isinstance(error, UnicodeDecodeError) else reason_of(error)
        raise ValueError(f"{path.relative_to(ROOT)}: cannot read: {what}") from error


def current(text: str, path: Path) -> str:
    """The text of the document at ``path`` as it has to be now. Raises ValueError if it names what is not there."""
    for _, change in CHANGES:
        text = change(text, path)
    return text
