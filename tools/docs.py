#!/usr/bin/env python3
"""Print the documentation: a page as text, the list of pages, or the lines that contain a word.

    python tools/docs.py
    python tools/docs.py camera
    python tools/docs.py confidence

A page is named as its file in docs/ without .md; hands.schema.json is the JSON Schema of tracks
and predictions.
"""

from __future__ import annotations

import argparse
import re
import sys
from collections.abc import Mapping
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

import tools

tools.begin(__name__)

from netlib.errors import NetlibError, did_you_mean
from netlib.files.paths import own
from tools.common.arguments import parser_of
from tools.common.commands import command
from tools.common.console import guarded, say


def main(argv: list[str] | None = None) -> int:
    """Run the tool; returns the exit status."""
    parser = parser_of(__doc__)
    parser.add_argument(
        "page",
        metavar="PAGE",
        nargs="?",
        help="such as camera; of another word the lines that contain it (default: the list of pages)",
    )
    return guarded(run, parser.parse_args(argv))


def run(args: argparse.Namespace) -> None:
    """Print what the arguments select. Raises NetlibError."""
    pages = _pages()
    if not args.page:
        _list(pages)
        return
    word = args.page.removeprefix("docs/").removesuffix(".md")
    if word in pages:
        print(pages[word], end="")
        return
    lines = [
        f"{name}: {line.strip()}"
        for name, text in pages.items()
        for line in text.splitlines()
        if word.lower() in line.lower()
    ]
    if not lines:
        raise NetlibError(
            f"{word}: no such page{did_you_mean(word, pages)}, and no page contains it; "
            f"'{command('docs')}' lists the pages"
        )
    say(f"no page is called {word!r}{did_you_mean(word, pages)}; these lines contain it:")
    say(*lines, sep="\n")


def _pages() -> dict[str, str]:
    """The text of each page by its name."""
    pages = {}
    for pattern in ("*.md", "*.schema.json"):
        for path in sorted(own("docs").glob(pattern)):
            name = path.name.removesuffix(".md")
            pages[name] = path.read_text(encoding="utf-8")
    return pages


def _list(pages: Mapping[str, str]) -> None:
    """Print the name and the title of each page."""
    width = max(map(len, pages))
    for name, text in pages.items():
        title = re.search(r'^# (.+)|^\s*"title": "(.+)"', text, re.MULTILINE)
        say(f"{name:{width}}  {title[1] or title[2] if title else ''}")


if __name__ == "__main__":
    sys.exit(main())
