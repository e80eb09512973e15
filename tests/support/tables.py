"""Tables of examples in text files: fields that ``|`` separates, and comments after ``#``."""

from __future__ import annotations

from pathlib import Path


def lines_of(table: Path) -> list[list[str]]:
    """Return the fields of each line."""
    text = table.read_text(encoding="utf-8")
    lines = [line for line in text.splitlines() if line and line[0] != "#"]
    return [[field.strip() for field in line.split("|")] for line in lines]


def pairs_of(table: Path) -> list[tuple[list[str], str]]:
    """Return rows of two lines: the fields of the first, and the second, which is one field."""
    lines = lines_of(table)
    return [(given, line) for given, [line] in zip(lines[::2], lines[1::2], strict=True)]


def records_of(table: Path) -> list[tuple[str, dict[str, list[str]]]]:
    """Return rows of several lines: the first one, and the fields of the indented lines below it by
    their first word.
    """
    records: list[tuple[str, dict[str, list[str]]]] = []
    for line in table.read_text(encoding="utf-8").splitlines():
        if line.startswith(" "):
            name, _, fields = line.strip().partition(" ")
            records[-1][1][name] = [field.strip() for field in fields.split("|")]
        elif line and line[0] != "#":
            records.append((line, {}))
    return records


def shape_of(word: str) -> tuple[int, ...]:
    """Return the shape (2, 3) for ``2x3``, and () for ``()``."""
    return () if word == "()" else tuple(int(size) for size in word.split("x"))
