"""Texts for the reader of an exercise, generated from the project's source.

The stub is the source without the bodies that the reader writes. In a debugging exercise the source
has one known mistake, which the reader finds and fixes. ``command`` is the command line of the
exercises, as the user starts it.
"""

from __future__ import annotations

import ast
import textwrap

from exercises.exercise import Exercise

WIDTH = 116  # of a comment, including indentation


def stub(exercise: Exercise, command: str) -> str:
    """Return the text of the stub. Raises DataError if the source cannot be read."""
    text = _cut(exercise, exercise.source())
    lines = text.splitlines()
    functions = {
        node.name: node for node in ast.walk(ast.parse(text)) if isinstance(node, ast.FunctionDef)
    }
    to_do = {functions[name.split(".")[-1]]: task for name, task in exercise.to_do.items()}
    # from the last on: the lines above keep their numbers
    for function in sorted(to_do, key=lambda function: -function.lineno):
        first, *rest = function.body
        body = rest[0] if ast.get_docstring(function) is not None else first
        lines[body.lineno - 1 : function.end_lineno] = _instead(to_do[function], body.col_offset)
    head = f"# Replace each NotImplementedError, then run: {command} {exercise.name}"
    return "\n".join([head, *lines, ""])


def _instead(task: str, indent: int) -> list[str]:
    """Return the lines in place of a body: the task as a comment, and an error."""
    space = " " * indent
    comment = []
    for paragraph in task.split("\n"):
        comment += textwrap.wrap(paragraph, WIDTH - indent, break_long_words=False)
    return [*(f"{space}# {line}" for line in comment), f"{space}raise NotImplementedError"]


def bugs(exercise: Exercise, command: str) -> list[str]:
    """Return the text of one file for each known mistake, in its first form.

    Raises DataError as ``stub``.
    """
    head = f"# This file contains one mistake. Find and fix it, then run: {command} {exercise.name}"
    sources = (mistake.sources(exercise)[0] for mistake in exercise.mistakes)
    return [f"{head} --file THIS_FILE\n{_cut(exercise, text)}" for text in sources]


def _cut(exercise: Exercise, text: str) -> str:
    """Return the source up to the end of the exercise."""
    return text.partition(exercise.end)[0].rstrip() + "\n" if exercise.end else text
