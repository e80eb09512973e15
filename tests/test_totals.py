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
    "benchmarks": Size(2199, 1426, 27.1),
    "docs": Size(1900, 1216, 29.3),
    "exercises": Size(4859, 2477, 35.1),
    "experiments": Size(2333, 1239, 33.5),
    "export": Size(1338, 822, 29.3),
    "fast": Size(5774, 3564, 34.9),
    "handpose": Size(22843, 13265, 34.2),
    "layers": Size(7576, 4358, 38.3),
    "models": Size(4, 0, 100.0),
    "netlib": Size(10442, 6055, 33.3),
    "prototxt": Size(3, 0, 100.0),
    "setup.py": Size(40, 16, 40.0),
    "tests": Size(58486, 32949, 27.9),
    "tools": Size(6699, 4205, 29.1),
}
WORDS = 96341  # of all documents


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
    found: dict[str, list[int]] = {}
    for path in tracked("*.py"):
        parts = path.relative_to(ROOT).parts
        sums = found.setdefault(parts[0] if len(parts) > 1 else "setup.py", [0, 0, 0])
        for i, count in enumerate(size_of(path.read_text(encoding="utf-8"))):
            sums[i] += count
    assert found.keys() == ROOMS.keys()
    for room, (lines, statements, airy) in found.items():
        assert lines <= ROOMS[room].lines, room
        assert statements <= ROOMS[room].statements, room
        assert 100 * airy / lines >= ROOMS[room].air - 2, room


def test_the_documents_keep_their_words() -> None:
    assert sum(len(path.read_text(encoding="utf-8").split()) for path in tracked("*.md")) <= WORDS
