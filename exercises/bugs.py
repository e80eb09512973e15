"""Find the bug: our source with one known mistake in the place of the right lines, to be found and fixed.

Mistakes written in full are used: a function, or methods that replace ours and use neither them nor a helper.
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
    """The files, one for each mistake that serves. Raises DataError if our source cannot be read."""
    source = files.read_text(own(exercise.file), "the source")
    made = (_with(exercise, source, mistake) for mistake in exercise.mistakes)
    return [text for text in made if text is not None]


def _with(exercise: Exercise, source: str, mistake: Mistake) -> str | None:
    lines, there = source.splitlines(), dict(functions(ast.parse(source)))
    written = _methods(exercise, mistake)
    if not written or not set(written) <= set(there):
        return None
    for name in sorted(written, key=lambda name: -there[name].lineno):
        old = there[name]
        new = ast.parse(textwrap.dedent(written[name])).body[0]
        assert isinstance(new, ast.FunctionDef)
        first, last = body_lines(new)
        body = textwrap.dedent(written[name]).splitlines()[first - 1 : last]
        first, last = body_lines(old)
        indent = " " * old.col_offset
        lines[first - 1 : last] = [f"{indent}{line}".rstrip() for line in body]
    head = f"# There is one mistake in this file. Find and fix it, then: {command('exercise')} {exercise.name}"
    return "\n".join([f"{head} --file THIS_FILE", *lines]) + "\n"


def _methods(exercise: Exercise, mistake: Mistake) -> dict[str, str]:
    """The source of what a mistake has of its own, by name as in our source; empty if it asks ours for a part of it."""
    part = mistake.part
    if inspect.isfunction(part):
        return {exercise.names[0]: inspect.getsource(part)}
    if not inspect.isclass(part) or part.__bases__ != (exercise.ours,):
        return {}
    own = {name: thing for name, thing in vars(part).items() if inspect.isfunction(thing)}
    found = {f"{exercise.ours.__name__}.{name}": inspect.getsource(thing) for name, thing in own.items()}
    ours = vars(sys.modules[exercise.ours.__module__])
    used = {name for thing in own.values() for name in thing.__code__.co_names if name in thing.__globals__}
    return {} if any("super()" in text for text in found.values()) or not used <= ours.keys() else found
