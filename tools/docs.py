#!/usr/bin/env python3
"""Show the documentation: a page as text, the list of pages, or the pages that contain a word.

    python tools/docs.py
    python tools/docs.py camera
    python tools/docs.py --find confidence

A page is named as its file in docs/ without .md; hands.schema.json is the JSON Schema of tracks and predictions. In a
terminal a page is shown with the pager (PAGER), q leaves it; otherwise it is printed.
"""

from __future__ import annotations

import argparse
import pydoc
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

import tools

tools.begin(__name__)

from netlib.errors import NetlibError, did_you_mean
from netlib.files.paths import own
from tools.common.arguments import parser_of
from tools.common.console import DONE, guarded, say


def main(argv: list[str] | None = None) -> int:
    """Run the tool; returns the exit status."""
    parser = parser_of(__doc__)
    parser.add_argument("page", metavar="PAGE", nargs="?", help="such as camera (default: the list of pages)")
    parser.add_argument("--find", metavar="WORDS", help="list the lines that contain these words")
    args = parser.parse_args(argv)
    if args.page and args.find:
        parser.error("expected either a page or --find")
    return guarded(run, args)


def run(args: argparse.Namespace) -> int:
    """Show what the arguments select. Raises NetlibError."""
    known = pages()
    if args.find:
        _find(known, args.find)
    elif args.page:
        _show(known, args.page)
    else:
        width = max(map(len, known))
        for name, path in known.items():
            say(f"{name:{width}}  {_title(path)}")
    return DONE


def pages() -> dict[str, Path]:
    """The file of each page by its name."""
    folder = own("docs")
    return {path.stem if path.suffix == ".md" else path.name: path
            for ending in ("*.md", "*.schema.json") for path in sorted(folder.glob(ending))}


def _show(known: dict[str, Path], name: str) -> None:
    path = known.get(name.removeprefix("docs/").removesuffix(".md"))
    if path is None:
        raise NetlibError(f"{name}: no such page{did_you_mean(name, known)}; without a name, all pages are listed")
    text = path.read_text(encoding="utf-8")
    if sys.stdout is not None and sys.stdout.isatty():  # None: a shell closed it
        pydoc.pager(text)
    else:
        print(text, end="")


def _find(known: dict[str, Path], words: str) -> None:
    found = [(name, line.strip()) for name, path in known.items()
             for line in path.read_text(encoding="utf-8").splitlines() if words.lower() in line.lower()]
    if not found:
        raise NetlibError(f"no page contains {words!r}")
    for name, line in found:
        say(f"{name}: {line}")


def _title(path: Path) -> str:
    """The heading of a page, or the title of a schema."""
    for line in path.read_text(encoding="utf-8").splitlines():
        if line.startswith("# "):
            return line.removeprefix("# ")
        if line.strip().startswith('"title"'):
            return line.split('"')[3]
    return ""


if __name__ == "__main__":
    sys.exit(main())
