"""Source files as the rules about them see them: what a file imports, and which files break a rule."""

from __future__ import annotations

import ast
from collections.abc import Mapping
from functools import cache
from pathlib import Path


@cache
def parsed(path: Path) -> ast.Module:
    """The syntax tree of a file."""
    return ast.parse(path.read_text(encoding="utf-8"))


@cache
def imports(path: Path) -> frozenset[str]:
    """Full names of all that a file imports, wherever in it."""
    return frozenset(imports_of(parsed(path)))


def imports_of(tree: ast.AST) -> set[str]:
    """The same of a syntax tree."""
    found = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"relative import in line {node.lineno}"
            found |= {f"{node.module}.{alias.name}" for alias in node.names}
    return found


def offenders(wrong: Mapping[str, set[str]]) -> dict[str, list[str]]:
    """The files that break a rule, each with what it has and should not have."""
    return {name: sorted(what) for name, what in wrong.items() if what}
