"""The navigation: the book, exercises, the reference in the order of the README, code, results, changes."""

from __future__ import annotations

import posixpath
import re
from collections.abc import Iterator
from typing import Any

from docs.making import markdown
from docs.making.site.published import Published

CODE = ("layers", "netlib", "handpose", "fast", "exercises", "export", "tools", "prototxt")
PAGES = {"The hand": "docs/hand.html", "Momentum": "docs/momentum.html", "Convolution and pooling": "docs/windows.html",
         "A small net": "docs/small_net.html"}  # fmt: skip


def of(site: Published) -> list[Any]:
    """As ``nav`` of mkdocs.yml would have it. A part that has no documents is left out."""
    pages = [{title: path} for title, path in PAGES.items() if path in site.as_they_are]
    parts = [
        ("Book", _folder(site, "docs/book")),
        ("Pages to try", pages),
        ("Exercises", _folder(site, "docs/exercises")),
        ("Reference", _reference(site)),
        ("Code", [{folder + "/": site.address(folder)} for folder in CODE if folder in site.folders]),
        ("Results", _folder(site, "docs/results")),
        ("Changes", [path for path in ("CHANGELOG.md", "CONTRIBUTING.md") if path in site.documents]),
    ]
    return [{"Start": "README.md"}, *({title: items} for title, items in parts if items)]


def paths(site: Published) -> set[str]:
    """The documents and folders that are in it."""
    found = set(_all(of(site)))
    return {path for path in (*site.documents, *site.folders) if site.address(path) in found}


def _all(item: Any) -> Iterator[str]:
    if isinstance(item, str):
        yield item
    else:
        for inner in item.values() if isinstance(item, dict) else item:
            yield from _all(inner)


def _folder(site: Published, folder: str) -> list[Any]:
    """The documents of a folder and of those below it, its README first, chapters by their number."""
    found = [path for path in site.documents if path.startswith(folder + "/")]

    def order(path: str) -> tuple[Any, ...]:
        name = posixpath.relpath(path, folder)
        number = re.match(r"\d+", name)
        return name != "README.md", int(number[0]) if number else 1000, name

    return sorted(found, key=order)


def _reference(site: Published) -> list[Any]:
    """The documents of docs/ itself, in the order of the README's list: its paragraph with most links to them."""
    found = [path for path in site.documents if posixpath.dirname(path) == "docs"]
    readme = (site.root / "README.md").read_text(encoding="utf-8")
    paragraphs = ([link.target for link in markdown.links(text)] for text in readme.split("\n\n"))
    named = max(([target for target in targets if target in found] for targets in paragraphs), key=len)
    return sorted(found, key=lambda path: (named.index(path) if path in named else len(named), path))
