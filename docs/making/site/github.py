"""The Markdown of GitHub, for which the documents are written, as Python-Markdown wants it, which makes the site.

    a list, a table        may follow a paragraph at once: here a blank line is put between them
    inside an item         two or three columns deeper are enough: here they become four per level
    ``<details>``          has Markdown inside: here it is told so

Links to source files and folders lead to their pages. Code stays as it is, fenced or between backquotes.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator

FENCE = re.compile(r"^ *(`{3,}(?=[^`]*$)|~{3,})")
ITEM = re.compile(r"^( *)([-+*]|\d{1,9}[.)])( +)(?=\S)")
DELIMITERS = re.compile(r"^ *\|?(?: *:?-+:? *\|)+(?: *:?-+:? *)?$")
RAW = re.compile(r"^ *<(details|summary)>")
HEADING = re.compile(r"^(#+) +(.*?)(?: +#+)? *$")
# A link or an image, after its text: `](target "title")`; a definition: `[name]: target`; or code, which is passed by.
CODE_OR_LINK = re.compile(
    r"(?P<code>(?<!`)(?P<ticks>`+)(?!`)(?:(?!\n\n).)+?(?<!`)(?P=ticks)(?!`))"
    r"|(?P<before>\]\(\s*<?|^ {0,3}\[[^\]\n]+\]: +<?)"
    r"(?P<target>(?<=<)[^<>\n]+(?=>)|[^\s<>()]+(?:\([^\s()]*\)[^\s<>()]*)?)",
    re.MULTILINE | re.DOTALL,
)
OUTSIDE = re.compile(r"[a-zA-Z][a-zA-Z0-9+.-]*:|//")


def anchor_of(heading: str, separator: str = "-") -> str:
    """The anchor that GitHub gives a heading."""
    return re.sub(r"[^\w\- ]", "", heading.strip().lower()).replace(" ", separator)


def title_of(text: str) -> str | None:
    """The first heading of a document, without its marks."""
    for code, lines in blocks(text):
        for line in lines if not code else ():
            if heading := HEADING.match(line):
                return re.sub(r"\\(.)", r"\1", heading[2].replace("`", ""))
    return None


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


def links(text: str) -> Iterator[str]:
    """What a document links to or shows, as it stands there, other places than this project left out."""
    for code, lines in blocks(text):
        if not code:
            for match in CODE_OR_LINK.finditer("\n".join(lines)):
                if match["target"] and not OUTSIDE.match(match["target"]):
                    yield match["target"]


def with_links(text: str, changed: Callable[[str], str]) -> str:
    """The document with ``changed(target)`` in place of every such target."""

    def replace(match: re.Match[str]) -> str:
        if not match["target"] or OUTSIDE.match(match["target"]):
            return match[0]
        return match["before"] + changed(match["target"])

    pieces = (lines if code else [CODE_OR_LINK.sub(replace, "\n".join(lines))] for code, lines in blocks(text) if lines)
    return "\n".join("\n".join(piece) for piece in pieces)


def for_python_markdown(text: str) -> str:
    """The document with its lists and tables set apart, items indented by fours, details open for Markdown."""
    made: list[str] = []
    levels: list[int] = []  # the column at which the content of each open item begins
    for code, lines in blocks(text):
        if code:
            shift = _shift_of(lines[0], levels)
            made += [" " * max(0, _indent(line) + shift) + line.lstrip(" ") if line.strip() else "" for line in lines]
            continue
        for index, line in enumerate(lines):
            after = lines[index + 1] if index + 1 < len(lines) else ""
            made += _line(line, after, made, levels)
    return "\n".join(made)


def _line(line: str, after: str, made: list[str], levels: list[int]) -> list[str]:
    """One line outside of code, with the blank line before it where one is missing."""
    item = ITEM.match(line)
    follows = bool(made) and bool(made[-1].strip())
    if not line.strip():
        return [""]
    if follows and not item and levels and _indent(line) < levels[-1] and not HEADING.match(line):
        return [line]  # the paragraph of an item goes on further to the left
    moved = " " * max(0, _indent(line) + _shift_of(line, levels)) + line.lstrip(" ")
    apart = False
    if item:
        apart = item[2] in ("-", "+", "*", "1.", "1)") and _ends_in_paragraph(made)
        levels.append(item.end())
        moved = moved.replace(item[2] + item[3], item[2].replace(")", ".") + " ", 1)
    elif "|" in line and DELIMITERS.match(after):
        apart = follows
    moved = RAW.sub(lambda found: found[0][:-1] + ' markdown="1">', moved)
    return ["", moved] if apart else [moved]


def _shift_of(line: str, levels: list[int]) -> int:
    """How far a line moves right. Closes the items that it is no part of."""
    while levels and _indent(line) < levels[-1]:
        levels.pop()
    return 4 * len(levels) - (levels[-1] if levels else 0)


def _ends_in_paragraph(made: list[str]) -> bool:
    """Whether the lines since the last blank one hold text, and no item of a list."""
    for line in reversed(made):
        if ITEM.match(line):
            return False
        if not line.strip():
            break
    return bool(made) and bool(made[-1].strip()) and not HEADING.match(made[-1])


def _indent(line: str) -> int:
    return len(line) - len(line.lstrip(" "))
