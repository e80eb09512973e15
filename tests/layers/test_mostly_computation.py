"""Most of a layer file computes, in every layer file of the paper's network.

A code line is a line of a function or method that is not a comment or docstring; declarations of options, class
attributes and constants do not count. A code line computes if it is in ``forward`` or ``backward``, or in a function or
method of the same file that these use, directly or indirectly. ``setup``, ``reshape`` and functions used only by them
do not compute.
"""

from __future__ import annotations

import ast
import inspect
from pathlib import Path

import pytest

from layers import LAYER_TYPES
from netlib.proto.net_parameter import load_parameter

ROOT = Path(__file__).resolve().parents[2]
LEAST = 0.4
TYPES = {spec.type for spec in load_parameter(ROOT / "prototxt/nyu_train_test.prototxt").layer}
FILES = sorted({Path(inspect.getfile(LAYER_TYPES[name])) for name in TYPES} | {ROOT / "layers/hand/kinematics.py"})
Function = ast.FunctionDef | ast.AsyncFunctionDef


def code_lines(function: Function) -> set[int]:
    """Return the lines of a function without its docstring."""
    statements = [node for node in ast.walk(function) if isinstance(node, ast.stmt) and not is_text(node)]
    return set().union(*map(lines_of, statements))


def functions_of(tree: ast.Module) -> list[Function]:
    """Return all functions and methods of a file."""
    return [node for node in ast.walk(tree) if isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef))]


def is_text(node: ast.stmt) -> bool:
    return isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) and isinstance(node.value.value, str)


def lines_of(node: ast.stmt) -> set[int]:
    """Return all lines of a simple statement, or the lines before the body of a compound one."""
    body = getattr(node, "body", None)
    end = body[0].lineno - 1 if body and body[0].lineno > node.lineno else node.end_lineno
    return set(range(node.lineno, (end or node.lineno) + 1))


def computing(tree: ast.Module) -> set[int]:
    """Return the lines that compute, as defined above."""
    functions: dict[str, list[Function]] = {}
    for function in functions_of(tree):
        functions.setdefault(function.name, []).append(function)
    reached, waiting = set(), ["forward", "backward"]
    lines: set[int] = set()
    while waiting:
        name = waiting.pop()
        if name in reached or name not in functions:
            continue
        reached.add(name)
        for function in functions[name]:
            lines |= code_lines(function)
            used = {n.attr for n in ast.walk(function) if isinstance(n, ast.Attribute)}
            waiting += used | {n.id for n in ast.walk(function) if isinstance(n, ast.Name)}
    return lines


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_most_of_a_layer_computes(path: Path) -> None:
    """At least two of five code lines compute."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    share = len(computing(tree)) / len(set().union(*map(code_lines, functions_of(tree))))
    assert share >= LEAST, f"{path.relative_to(ROOT)}: {share:.0%} of its code lines compute, expected {LEAST:.0%}"
