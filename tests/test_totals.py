"""The size of the project: a total for each room, which may only fall (CONTRIBUTING.md, "Size").

A row gives the most lines, the most Python statements, and the share of lines that are blank or in docstrings when the
row was recorded. That share may fall by at most two points: a room is made smaller by doing less, not by dense code.
"""

from __future__ import annotations

import ast
import subprocess
from pathlib import Path
from typing import NamedTuple

import pytest

ROOT = Path(__file__).resolve().parents[1]


class Size(NamedTuple):
    """Lines, statements without docstrings, and the percentage of lines that are blank or in docstrings."""

    lines: int
    statements: int
    air: float


ROOMS = {
    "docs": Size(1893, 1209, 29.4),
    "exercises": Size(2127, 889, 25.1),
    "experiments": Size(2379, 1423, 31.3),
    "export": Size(1250, 770, 29.4),
    "fast": Size(5077, 3083, 35.5),
    "handpose": Size(16777, 9669, 35.0),
    "layers": Size(7394, 4209, 38.9),
    "netlib": Size(9198, 5407, 32.9),
    "setup.py": Size(40, 16, 40.0),
    "tests": Size(38868, 21785, 25.7),
    "tests/support": Size(1456, 805, 28.0),  # a part of the row above
    "tools": Size(4963, 3102, 29.8),
}
LINES = {  # of files that are not Python, by their patterns
    ("prototxt/*.prototxt", "models/*.prototxt"): 3892,
    ("*.js", "*.css", "*.html"): 2830,
}
WORDS = 66166  # of all documents


def tracked(*patterns: str) -> list[Path]:
    """The files under version control that match."""
    if not (ROOT / ".git").exists():
        pytest.skip("the project's files are not under version control here")
    done = subprocess.run(["git", "ls-files", "-z", *patterns], cwd=ROOT, capture_output=True, text=True, check=True)
    return [ROOT / name for name in done.stdout.split("\0") if name and (ROOT / name).is_file()]


def size_of(source: str) -> tuple[int, int, int]:
    """Lines of Python source, its statements without docstrings, and its lines that are blank or in docstrings."""
    lines = source.splitlines()
    blank = {number for number, line in enumerate(lines, 1) if not line.strip()}
    statements = 0
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.stmt):
            statements += 1
        has_docstring = isinstance(node, (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef))
        if has_docstring and ast.get_docstring(node, clean=False) is not None:
            statements -= 1
            blank.update(range(node.body[0].lineno, (node.body[0].end_lineno or 0) + 1))
    return len(lines), statements, len(blank)


EXAMPLE = '''"""A module.

Two lines.
"""


def f(x):
    """Return x."""
    if x:
        y = x; x = y
    return x
'''


def test_a_size_is_counted_right() -> None:
    assert size_of(EXAMPLE) == (11, 5, 7)


def test_every_room_keeps_its_total() -> None:
    found: dict[str, list[int]] = {room: [0, 0, 0] for room in ROOMS}
    for path in tracked("*.py"):
        sizes = size_of(path.read_text(encoding="utf-8"))
        where = path.relative_to(ROOT)
        rooms = [room for room in ROOMS if where.is_relative_to(room)]
        assert rooms or not sizes[1], f"{where}: no room has it"
        for room in rooms:
            found[room] = [sum(pair) for pair in zip(found[room], sizes)]
    for room, (lines, statements, airy) in found.items():
        assert lines <= ROOMS[room].lines, room
        assert statements <= ROOMS[room].statements, room
        assert 100 * airy / lines >= ROOMS[room].air - 2, room


@pytest.mark.parametrize("patterns", LINES)
def test_other_files_keep_their_totals(patterns: tuple[str, ...]) -> None:
    assert sum(len(path.read_text(encoding="utf-8").splitlines()) for path in tracked(*patterns)) <= LINES[patterns]


def test_the_documents_keep_their_words() -> None:
    assert sum(len(path.read_text(encoding="utf-8").split()) for path in tracked("*.md")) <= WORDS
