"""The chapters of the book as notebooks: ``make book`` writes build/book/*.ipynb, to be opened in the project's folder.

python -m docs.making.notebooks

Text becomes Markdown cells, ``python`` and ``pycon`` blocks become code cells without prompts. Blocks of other kinds
and those that are marked as not run stay text. A statement that should raise is in a separate cell, tagged
``raises-exception``, so that the cells after it run.
"""

from __future__ import annotations

import doctest
import json
import sys
from collections.abc import Iterator
from typing import Any

from docs.making.markdown import blocks
from netlib.errors import reason_of
from netlib.files import atomic
from netlib.files.paths import ROOT

PLACE = ROOT / "build" / "book"
FIRST = "import os, sys\nos.chdir({root!r})\nsys.path.insert(0, os.getcwd())"  # paths are those of the project


RAISES = "raises-exception"  # a tag of Jupyter's


def cells(text: str) -> Iterator[tuple[str, str]]:
    """The cells of a document: ("markdown", "code" or RAISES, the text)."""
    prose: list[str] = []
    for code, lines in blocks(text):
        tag = lines[0].strip().removeprefix("```") if code and lines else ""
        above = next((line for line in reversed(prose) if line.strip()), "")
        shown = above.startswith("<!-- not run") or above.startswith("<!-- code:")
        if tag not in ("python", "pycon") or shown:
            prose += lines
            continue
        if "".join(prose).strip():
            yield "markdown", "\n".join(prose).strip()
        prose = []
        body = "\n".join(lines[1:-1])
        if tag == "pycon":
            yield from _without_prompts(body)
        else:
            yield "code", body
    if "".join(prose).strip():
        yield "markdown", "\n".join(prose).strip()


def _without_prompts(body: str) -> Iterator[tuple[str, str]]:
    """The statements of a session, without what they print."""
    source = ""
    for example in doctest.DocTestParser().get_examples(body):
        if example.exc_msg is None:
            source += example.source
            continue
        if source:
            yield "code", source.rstrip("\n")
        yield RAISES, example.source.rstrip("\n")
        source = ""
    if source:
        yield "code", source.rstrip("\n")


def notebook(text: str) -> dict[str, Any]:
    """A document as a notebook of version 4.5."""
    found = [("code", FIRST.format(root=str(ROOT))), *cells(text)]
    return {
        "nbformat": 4, "nbformat_minor": 5,
        "metadata": {"kernelspec": {"name": "python3", "display_name": "Python 3", "language": "python"}},
        "cells": [_cell(i, kind, source) for i, (kind, source) in enumerate(found)],
    }  # fmt: skip


def _cell(number: int, kind: str, source: str) -> dict[str, Any]:
    tags = {"tags": [RAISES]} if kind == RAISES else {}
    common = {"id": f"cell-{number}", "metadata": tags, "source": source.splitlines(keepends=True)}
    if kind == "markdown":
        return {"cell_type": "markdown", **common}
    return {"cell_type": "code", "execution_count": None, "outputs": [], **common}


def main() -> int:
    """Write them, and print their names; returns the exit status."""
    try:
        PLACE.mkdir(parents=True, exist_ok=True)
        for chapter in sorted((ROOT / "docs" / "book").glob("[0-9]*.md")):
            path = PLACE / f"{chapter.stem}.ipynb"
            text = json.dumps(notebook(chapter.read_text(encoding="utf-8")), ensure_ascii=False, indent=1)
            atomic.replace_text(path, text + "\n")
            print(f"wrote {path.relative_to(ROOT)}")
    except OSError as error:
        print(f"error: {reason_of(error)}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
