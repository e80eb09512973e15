"""What a document, written for GitHub, has in it: code, headings, links. In code there are none of the others."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from typing import NamedTuple

FENCE = re.compile(r"^ *(`{3,}(?=[^`]*$)|~{3,})")
HEADING = re.compile(r"^(#+) +(.*?)(?: +#+)? *$")
# A link or an image, after its text: `](target "title")`; a definition: `[name]: target`; or code, which is passed by.
CODE_OR_LINK = re.compile(
    r"(?P<code>(?<!`)(?P<ticks>`+)(?!`)(?:(?!\n\n).)+?(?<!`)(?P=ticks)(?!`))"
    r"|(?P<before>\]\(\s*<?|^ {0,3}\[[^\]\n]+\]: +<?)"
    r"(?P<target>(?<=<)[^<>\n]+(?=>)|[^\s<>()]+(?:\([^\s()]*\)[^\s<>()]*)?)"
    r'(?=>?(?:\s+"(?P<title>[^"\n]*)")?)',
    re.MULTILINE | re.DOTALL,
)
OUTSIDE = re.compile(r"[a-zA-Z][a-zA-Z0-9+.-]*:|//")


class Link(NamedTuple):
    """The target of a link or an image, unchanged, and its title; empty without one."""

    target: str
    title: str


def blocks(text: str) -> Iterator[tuple[bool, list[str]]]:
    """The lines of a document, fenced code apart: (it is code, its lines with the fences)."""
    lines: list[str] = []
    fence = ""
    for line in text.split("\n"):
        found = FENCE.match(line)
        if fence:
            lines.append(line)
            if found and found[1].startswith(fence) and not line.strip(" " + fence[0]):
                yield True, lines
                lines, fence = [], ""
        elif found:
            yield False, lines
            lines, fence = [line], found[1]
        else:
            lines.append(line)
    yield bool(fence), lines


def headings(text: str) -> Iterator[str]:
    """The headings of a document, as they stand there."""
    for code, lines in blocks(text):
        for line in lines if not code else ():
            if heading := HEADING.match(line):
                yield heading[2]


def title_of(text: str) -> str | None:
    """The first heading of a document, without its marks."""
    first = next(headings(text), None)
    return None if first is None else re.sub(r"\\(.)", r"\1", first.replace("`", ""))


def anchor_of(heading: str, separator: str = "-") -> str:
    """The anchor that GitHub gives a heading."""
    return re.sub(r"[^\w\- ]", "", heading.strip().lower()).replace(" ", separator)


def links(text: str) -> Iterator[Link]:
    """What a document links to or shows, other places than this project left out."""
    for code, lines in blocks(text):
        if not code:
            for match in CODE_OR_LINK.finditer("\n".join(lines)):
                if match["target"] and not OUTSIDE.match(match["target"]):
                    yield Link(match["target"], match["title"] or "")


def with_links(text: str, changed: Callable[[Link], str]) -> str:
    """The document with ``changed(link)`` in place of every such target."""

    def replace(match: re.Match[str]) -> str:
        if not match["target"] or OUTSIDE.match(match["target"]):
            return match[0]
        return match["before"] + changed(Link(match["target"], match["title"] or ""))

    pieces = (lines if code else [CODE_OR_LINK.sub(replace, "\n".join(lines))] for code, lines in blocks(text) if lines)
    return "\n".join("\n".join(piece) for piece in pieces)
