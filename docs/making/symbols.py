"""Where a name stands in a file: of Python a function, class, method or constant, of prototxt a layer or a field.

Kinematics.forward      a method; ``Kinematics`` alone is the class
FC1                     the message with ``name: "FC1"``, at any depth
base_lr                 the field of that name
FC1.num_output          the field within that message, at any depth
"""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

from netlib.proto import prototxt
from netlib.proto.prototxt import Field, Message, Position, Scalar

SUFFIXES = (".py", ".prototxt")  # the files that have names


def line_of(path: Path, wanted: str) -> int:
    """The line on which a file has a name, counted from 1. Raises ValueError if it has none, or several."""
    text = path.read_text(encoding="utf-8")
    if path.suffix == ".prototxt":
        return _line_in_prototxt(prototxt.parse(text, path.name), wanted, path.name)
    return statement_of(ast.parse(text), wanted, path.name).lineno


def statement_of(tree: ast.Module, wanted: str, name: str) -> ast.stmt:
    """The statement that makes a name of a Python file. Raises ValueError if there is none."""
    statements, found = tree.body, None
    for part in wanted.split("."):
        found = next((statement for statement in statements if part in _names(statement)), None)
        if found is None:
            raise ValueError(f"{name} has no {wanted}")
        statements = found.body if isinstance(found, ast.ClassDef) else []
    assert found is not None
    return found


def _names(statement: ast.stmt) -> list[str]:
    if isinstance(statement, (ast.FunctionDef, ast.ClassDef)):
        return [statement.name]
    if isinstance(statement, ast.Assign):
        targets = statement.targets
    else:
        targets = [statement.target] if isinstance(statement, ast.AnnAssign) else []
    return [target.id for target in targets if isinstance(target, ast.Name)]


def _line_in_prototxt(message: Message, wanted: str, name: str) -> int:
    places = [message.position]
    for part in wanted.split("."):
        found = list(_fields(message, part))
        if len(found) != 1:
            raise ValueError(f"{name} has {'no' if not found else len(found)} {wanted}")
        places.append(found[0].position)
        message = found[0].value if isinstance(found[0].value, Message) else Message([], found[0].position)
    assert isinstance(places[-1], Position)
    return places[-1].line


def _fields(message: Message, part: str) -> Iterator[Field]:
    """The fields called ``part``, and those whose message has this name, at any depth."""
    for field in message.fields:
        value = field.value
        named = isinstance(value, Message) and [v.text for v in value.values("name") if isinstance(v, Scalar)] == [part]
        if field.name == part or named:
            yield field
        if isinstance(value, Message):
            yield from _fields(value, part)
