"""The chapters of the book as notebooks: ``make book`` writes build/book/*.ipynb.

python -m docs.making.notebooks

Text becomes Markdown cells, ``python`` and ``pycon`` blocks become code cells without prompts, with the output that the
chapter shows below them. Blocks of other kinds and those that are marked as not run stay text. A statement that should
raise is in a separate cell, tagged ``raises-exception``, so that the cells after it run.

Links are relative to the notebook; a link to a chapter leads to its notebook. Pictures are copied to build/book/images,
because Jupyter serves only the folder in which it was started. Jupyter, VS Code and code hosts give headings different
anchors, so a heading that a chapter links to has a separate anchor.
"""

from __future__ import annotations

import doctest
import json
import os
import re
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

from docs.making.markdown import HEADING, Link, anchor_of, blocks, links, with_links
from netlib.errors import reason_of
from netlib.files import atomic
from netlib.files.paths import ROOT

PLACE = ROOT / "build" / "book"
PICTURES = PLACE / "images"
# Jupyter and VS Code start a notebook in its own folder.
FIRST = """\
# Run this cell first: the code of the chapter runs in the project's folder.
import os, sys
from pathlib import Path

folders = [Path.cwd(), *Path.cwd().parents]
project = next((str(folder) for folder in folders if (folder / "docs" / "book").is_dir()), None)
if project is None:
    raise FileNotFoundError("no docs/book above this notebook: keep it in build/book")
os.chdir(project)
sys.path.insert(0, project)"""
RAISES = "raises-exception"  # a tag of Jupyter's


class Cell(NamedTuple):
    """A cell: ("markdown", "code" or RAISES, the text, what the chapter shows below it)."""

    kind: str
    text: str
    shown: str = ""


def cells(text: str) -> Iterator[Cell]:
    """The cells of a document."""
    prose: list[str] = []
    for code, lines in blocks(text):
        tag = lines[0].strip().removeprefix("```") if code and lines else ""
        above = next((line for line in reversed(prose) if line.strip()), "")
        shown = above.startswith("<!-- not run") or above.startswith("<!-- code:")
        if tag not in ("python", "pycon") or shown:
            prose += lines
            continue
        if "".join(prose).strip():
            yield Cell("markdown", "\n".join(prose).strip())
        prose = []
        body = "\n".join(lines[1:-1])
        if tag == "pycon":
            yield from _without_prompts(body)
        else:
            yield Cell("code", body)
    if "".join(prose).strip():
        yield Cell("markdown", "\n".join(prose).strip())


def _without_prompts(body: str) -> Iterator[Cell]:
    """The statements of a session; each that prints something ends a cell."""
    source = ""
    for example in doctest.DocTestParser().get_examples(body):
        if example.exc_msg is None:
            source += example.source
            if example.want:
                yield Cell("code", source.rstrip("\n"), example.want)
                source = ""
            continue
        if source:
            yield Cell("code", source.rstrip("\n"))
        yield Cell(RAISES, example.source.rstrip("\n"), example.exc_msg)
        source = ""
    if source:
        yield Cell("code", source.rstrip("\n"))


def notebook(text: str, document: Path) -> dict[str, Any]:
    """The chapter at ``document`` as a notebook of version 4.5."""
    here = with_links(_with_anchors(text, document), lambda link: _from_notebook(link, document))
    found = [*cells(here)]
    if any(cell.kind != "markdown" for cell in found):
        title, heading, rest = found[0].text.partition("\n## ")
        found[:1] = [Cell("markdown", title.rstrip()), Cell("code", FIRST), Cell("markdown", (heading + rest).lstrip())]
    return {
        "nbformat": 4, "nbformat_minor": 5,
        "metadata": {
            "kernelspec": {"name": "python3", "display_name": "Python 3", "language": "python"},
            "language_info": {"name": "python"},
        },
        "cells": [_cell(i, cell) for i, cell in enumerate(found)],
    }


def _chapters() -> list[Path]:
    return sorted((ROOT / "docs" / "book").glob("[0-9]*.md"))


def _from_notebook(link: Link, document: Path) -> str:
    """The target of a link as the notebook needs it."""
    name, mark, anchor = link.target.partition("#")
    if not name:
        return link.target
    path = document.parent / name
    if path.suffix == ".svg":
        return f"images/{path.name}"
    target = PLACE / f"{path.stem}.ipynb" if path in _chapters() else Path(os.path.normpath(path))
    return Path(os.path.relpath(target, PLACE)).as_posix() + mark + anchor


def _with_anchors(text: str, document: Path) -> str:
    """The chapter with an anchor before each heading that a chapter links to."""
    wanted = set()
    for chapter in _chapters():
        for link in links(chapter.read_text(encoding="utf-8")):
            name, _, anchor = link.target.partition("#")
            if anchor and (chapter.parent / name if name else chapter) == document:
                wanted.add(anchor)

    def line_of(line: str) -> str:
        heading = HEADING.match(line)
        anchor = anchor_of(heading[2]) if heading else ""
        return f'<a id="{anchor}"></a>\n\n{line}' if anchor in wanted else line

    return "\n".join(line if code else line_of(line) for code, lines in blocks(text) for line in lines)


def _cell(number: int, cell: Cell) -> dict[str, Any]:
    tags = {"tags": [RAISES]} if cell.kind == RAISES else {}
    common = {"id": f"cell-{number}", "metadata": tags, "source": cell.text.splitlines(keepends=True)}
    if cell.kind == "markdown":
        return {"cell_type": "markdown", **common}
    outputs: list[dict[str, Any]] = []
    if cell.kind == RAISES:
        error, _, words = cell.shown.rstrip("\n").partition(": ")
        outputs = [{"output_type": "error", "ename": error, "evalue": words, "traceback": [cell.shown.rstrip("\n")]}]
    elif cell.shown:
        printed = re.sub(r"^<BLANKLINE>$", "", cell.shown, flags=re.MULTILINE).splitlines(keepends=True)
        outputs = [{"output_type": "stream", "name": "stdout", "text": printed}]
    return {"cell_type": "code", "execution_count": None, "outputs": outputs, **common}


def main() -> int:
    """Write them, and print their names; returns the exit status."""
    try:
        PLACE.mkdir(parents=True, exist_ok=True)
        for chapter in _chapters():
            path = PLACE / f"{chapter.stem}.ipynb"
            made = notebook(chapter.read_text(encoding="utf-8"), chapter)
            text = json.dumps(made, ensure_ascii=False, indent=1)
            atomic.replace_text(path, text + "\n")
            print(f"wrote {path.relative_to(ROOT)}")
        for picture in sorted((ROOT / "docs" / "images" / "book").glob("*.svg")):
            atomic.replace_bytes(PICTURES / picture.name, picture.read_bytes())
        print("Open them in VS Code, or in Jupyter, started in this folder:\n"
              ".venv/bin/pip install jupyterlab && .venv/bin/jupyter lab")
    except OSError as error:
        print(f"error: {reason_of(error)}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
