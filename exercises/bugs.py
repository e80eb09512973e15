"""Debugging exercises: the project's source with one known mistake inserted, which the reader finds and fixes.

Only self-contained mistakes are used: a function, or methods that call neither super() nor a helper.
"""

from __future__ import annotations

import ast
import inspect
import sys
import textwrap

from exercises.exercise import Exercise, Mistake
from exercises.reading import body_lines, functions
from netlib import files
from netlib.files.paths import command, own


def bugs(exercise: Exercise) -> list[str]:
    """Return the text of one file for each usable mistake. Raises DataError if the source cannot be read."""
    source = files.read_text(own(exercise.file), "the source")
    texts = (_with(exercise, source, mistake) for mistake in exercise.mistakes)
    return [text for text in texts if text is not None]


def _with(exercise: Exercise, source: str, mistake: Mistake) -> str | None:
    lines, defined = source.splitlines(), dict(functions(ast.parse(source)))
    written = _methods(exercise, mistake)
    if not written or not set(written) <= set(defined):
        return None
    for name in sorted(written, key=lambda name: -defined[name].lineno):
        old = defined[name]
        new = ast.parse(textwrap.dedent(written[name])).body[0]
        assert isinstance(new, ast.FunctionDef)
        first, last = body_lines(new)
        body = textwrap.dedent(written[name]).splitlines()[first - 1 : last]
        first, last = body_lines(old)
        indent = " " * old.col_offset
        lines[first - 1 : last] = [f"{indent}{line}".rstrip() for line in body]
    head = f"# This file contains one mistake. Find and fix it, then run: {command('exercise')} {exercise.name}"
    return "\n".join([f"{head} --file THIS_FILE", *lines]) + "\n"


def _methods(exercise: Exercise, mistake: Mistake) -> dict[str, str]:
    """Map qualified names to the source that a mistake overrides; empty if the mistake depends on the original."""
    part = mistake.part
    if inspect.isfunction(part):
        return {exercise.names[0]: inspect.getsource(part)}
    if not inspect.isclass(part) or part.__bases__ != (exercise.reference,):
        return {}
    own = {name: thing for name, thing in vars(part).items() if inspect.isfunction(thing)}
    found = {f"{exercise.reference.__name__}.{name}": inspect.getsource(thing) for name, thing in own.items()}
    namespace = vars(sys.modules[exercise.reference.__module__])
    used = {name for thing in own.values() for name in thing.__code__.co_names if name in thing.__globals__}
    return {} if any("super()" in text for text in found.values()) or not used <= namespace.keys() else found
