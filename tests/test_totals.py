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


ROOMS = {  # the longest matching name counts
    "netlib": Size(11300, 6000, 36),
    "netlib/*.py": Size(2300, 1300, 36),
    "layers": Size(7850, 4300, 36),
    "fast": Size(5700, 3100, 36),
    "export": Size(1250, 700, 36),
}
WORDS = {"README.md": 900, "docs/*.md": 51700, "docs/results": 1200, "": 95000}


@pytest.fixture(scope="module")
def tracked() -> list[Path]:
    """The files under version control."""
    if not (ROOT / ".git").exists():
        pytest.skip("the project's files are not under version control here")
    done = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, text=True, check=True)
    return [path for name in done.stdout.split("\0") if name and (path := Path(name)) and (ROOT / path).is_file()]


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
