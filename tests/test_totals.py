"""The size of the project: totals for each room, which may only fall (CONTRIBUTING.md, "Size").

    python tests/test_totals.py    prints the rows below with the present measures, and the limits

Layout changes no measure of Python code. A row is what was measured when it was recorded.
"""

from __future__ import annotations

import ast
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import pytest

ROOT = Path(__file__).resolve().parents[1]
LONG = 25  # syntax nodes; a statement with more is a long one


class Size(NamedTuple):
    """The size of Python code, without docstrings and annotations.

    nodes       syntax nodes
    statements  statements but definitions and imports
    long        those with more than LONG nodes of their own, not in inner statements
    strings     bytes of string constants
    """

    nodes: int
    statements: int
    long: int
    strings: int


ROOMS = {
    "docs": Size(12_947, 1_086, 16, 8_324),
    "exercises": Size(8_998, 817, 6, 32_728),
    "experiments": Size(15_779, 1_395, 22, 9_325),
    "export": Size(8_400, 737, 5, 3_877),
    "fast": Size(29_347, 2_600, 12, 2_370),
    "handpose": Size(99_550, 9_043, 114, 36_875),
    "handpose/synthetic": Size(16_598, 1_505, 22, 2_081),
    "layers": Size(36_985, 3_208, 30, 18_250),
    "netlib": Size(44_593, 4_579, 53, 41_206),
    "setup.py": Size(181, 10, 1, 291),
    "tests": Size(258_000, 19_284, 363, 322_403),
    "tools": Size(31_084, 2_980, 37, 32_139),
}
LINES = {  # of files that are not Python, by their patterns
    "prototxt/*.prototxt models/*.prototxt": 4_039,
    "*.json": 400,
    "*.js *.css *.html": 2_832,
    "*.proto": 1_354,
}
WORDS = {  # of documents, by their pattern
    ":(glob)docs/*.md": 25_943,
    "README.md": 896,
    "*.md": 65_000,
}
OTHERS = LINES | WORDS
LIMITS = {  # that no recorded total may exceed: syntax nodes of rooms, lines, words
    "docs": 13_050,  # these two grew by 2% when each step of their examples got a name
    "exercises": 9_000,
    "experiments": 13_100,
    "export": 8_400,
    "fast": 29_400,
    "handpose": 83_700,
    "handpose/synthetic": 14_700,
    "layers": 37_000,
    "netlib": 41_500,
    "tests": 243_000,
    "tools": 25_500,
    "*.js *.css *.html": 2_900,
    ":(glob)docs/*.md": 26_500,
    "README.md": 900,
    "*.md": 65_000,
}
# These do, and are to shrink.
ABOVE = ["experiments", "handpose", "handpose/synthetic", "netlib", "tests", "tools"]


def tracked(*patterns: str) -> list[Path]:
    """The files under version control that match."""
    if not (ROOT / ".git").exists():
        pytest.skip("the project's files are not under version control here")
    command = ["git", "ls-files", "-z", *patterns]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True)
    return [ROOT / name for name in done.stdout.split("\0") if name and (ROOT / name).is_file()]


def is_docstring(node: ast.AST) -> bool:
    return isinstance(node, ast.Expr) and isinstance(getattr(node.value, "value", None), str)


def children(node: ast.AST) -> Iterator[ast.AST]:
    """The nodes that count, directly below a node."""
    for field, value in ast.iter_fields(node):
        if field in ("annotation", "returns"):
            continue
        for child in value if isinstance(value, list) else [value]:
            is_node = isinstance(child, ast.AST) and not isinstance(child, ast.expr_context)
            if is_node and not is_docstring(child):
                yield child


def all_nodes(node: ast.AST) -> Iterator[ast.AST]:
    """The node and all nodes below it that count."""
    yield node
    for child in children(node):
        yield from all_nodes(child)


def own_nodes(node: ast.AST) -> int:
    """The number of nodes of a statement without those of the statements in it."""
    inner = (ast.stmt, ast.ExceptHandler, ast.match_case)
    return 1 + sum(own_nodes(child) for child in children(node) if not isinstance(child, inner))


def size_of(source: str) -> Size:
    nodes = list(all_nodes(ast.parse(source)))
    others = (ast.FunctionDef, ast.ClassDef, ast.Import, ast.ImportFrom)
    own = [own_nodes(n) for n in nodes if isinstance(n, ast.stmt) and not isinstance(n, others)]
    values = [node.value for node in nodes if isinstance(node, ast.Constant)]
    strings = "".join(value for value in values if isinstance(value, str))
    size = len(strings.encode(errors="surrogatepass"))
    return Size(len(nodes), len(own), sum(n > LONG for n in own), size)


def sizes() -> dict[Path, Size]:
    """The size of each file, by its path in the project."""
    paths = tracked("*.py")
    return {path.relative_to(ROOT): size_of(path.read_text(encoding="utf-8")) for path in paths}


def measured() -> dict[str, Size]:
    """The present size of each room; handpose/synthetic is a part of another."""
    found = sizes().items()
    inside = {room: [size for path, size in found if path.is_relative_to(room)] for room in ROOMS}
    return {room: Size(*map(sum, zip(*parts))) for room, parts in inside.items() if parts}


def other_size(patterns: str) -> int:
    """The lines, of documents the words, of the files that match patterns between spaces."""
    texts = [path.read_text(encoding="utf-8") for path in tracked(*patterns.split())]
    parts_of = str.split if patterns in WORDS else str.splitlines
    return sum(len(parts_of(text)) for text in texts)


EXAMPLE = '''"""A module: 8 nodes with it, 2 statements, and 2 bytes."""


def f(x: list[int]) -> str:
    """Return é."""
    if x:
        return "é"
'''


@pytest.mark.parametrize("source", [EXAMPLE, "def f(x):\n    if x: return 'é'"])
def test_a_size_is_counted_right(source: str) -> None:
    """The same for any layout, with and without types and docstrings."""
    assert size_of(source) == Size(nodes=8, statements=2, long=0, strings=2)


def test_a_long_statement_is_long_without_those_in_it() -> None:
    """The sum of n names has 3 n - 2 nodes: an operator between two of them has two."""
    short, long = f"b = {' + '.join('a' * 8)}", f"b = {' + '.join('a' * 9)}"
    assert size_of(f"if a:\n    {long}\n    {short}\n").long == 1


def test_every_room_keeps_its_totals() -> None:
    """The share of long statements may only fall, whatever the number of statements is."""
    for room, size in measured().items():
        recorded = ROOMS[room]
        assert size.nodes <= recorded.nodes, room
        assert size.long * recorded.statements <= recorded.long * size.statements, room
        assert size.strings <= recorded.strings, room


def test_every_file_has_a_room() -> None:
    for path, size in sizes().items():
        assert any(map(path.is_relative_to, ROOMS)) or not size.statements, path


@pytest.mark.parametrize("name", LIMITS)
def test_a_recorded_total_is_within_its_limit(name: str) -> None:
    """What is above its limit is named, until it no longer is."""
    recorded = ROOMS[name].nodes if name in ROOMS else OTHERS[name]
    assert (recorded > LIMITS[name]) == (name in ABOVE)


@pytest.mark.parametrize("patterns", OTHERS)
def test_other_files_keep_their_totals(patterns: str) -> None:
    assert other_size(patterns) <= OTHERS[patterns]


def print_rows() -> None:
    """Print the tables of this file with the present measures, shares and limits as comments."""
    for room, size in measured().items():
        share = f"{size.long / size.statements:.1%} long"
        limit = f", of {LIMITS[room]:_} nodes" if room in LIMITS else ""
        print(f'    "{room}": Size{tuple(size)},  # {share}{limit}')
    for patterns in OTHERS:
        print(f'    "{patterns}": {other_size(patterns)},')


if __name__ == "__main__":
    print_rows()
