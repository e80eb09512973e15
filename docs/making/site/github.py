"""The Markdown of GitHub, for which the documents are written, converted for Python-Markdown, which builds the site.

    a list, a table        may follow a paragraph at once: here a blank line is put between them
    inside an item         two or three columns deeper are enough: here they become four per level
    ``<details>``          has Markdown inside: here it is marked as such

Code stays as it is.
"""

from __future__ import annotations

import re

from docs.making.markdown import HEADING, blocks

ITEM = re.compile(r"^( *)([-+*]|\d{1,9}[.)])( +)(?=\S)")
DELIMITERS = re.compile(r"^ *\|?(?: *:?-+:? *\|)+(?: *:?-+:? *)?$")
RAW = re.compile(r"^ *<(details|summary)>")


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
        return [line]  # the paragraph of an item continues further to the left
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
