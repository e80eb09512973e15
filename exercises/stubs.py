"""Texts for the reader of an exercise, generated from the project's source.

The stub is the source without the bodies that the reader writes. In a debugging exercise the source has one known
mistake, which the reader finds and fixes. Only self-contained mistakes are used: a function, or methods that call
neither super() nor a helper.
"""

from __future__ import annotations

import ast
import inspect
import re
import textwrap

from exercises.exercise import Exercise, Mistake
from exercises.reading import body_lines, functions
from netlib import files
from netlib.files.own_modules import own_module
from netlib.files.paths import command, own

WIDTH = 116  # of a comment, including indentation


def stub(exercise: Exercise, *, bare: bool = False) -> str:
    """Return the text of the stub; ``bare``: without formulas and hints.

    Raises DataError if the source cannot be read.
    """
    text = files.read_text(own(exercise.file), "the source")
    lines, tree = text.splitlines(), ast.parse(text)
    defined = dict(functions(tree))
    for name in sorted(exercise.to_do, key=lambda name: -defined[name].lineno):
        function = defined[name]
        first, last = body_lines(function)
        lines[first - 1 : last] = _instead("" if bare else exercise.to_do[name], function.body[0].col_offset)
    text = "\n".join(lines) + "\n"
    text = _without_formulas(text) if bare else text
    text = _with_numpy(_kept(text, exercise.keep) if exercise.keep else text)
    return f"# Replace each NotImplementedError, then run: {command('exercise')} {exercise.name}\n{text}"


def _without_formulas(text: str) -> str:
    """Reduce the module docstring to its title and the description of the blobs."""
    docstring = ast.parse(text).body[0]
    paragraphs = (ast.get_docstring(ast.parse(text)) or "").split("\n\n")
    blobs = [one for one in paragraphs[1:] if one.startswith(("bottom[", "top["))]
    rest = text.splitlines()[docstring.end_lineno :]
    return "\n".join(['"""' + "\n\n".join([paragraphs[0], *blobs]) + ('\n"""' if blobs else '"""'), *rest]) + "\n"


def _instead(task: str, indent: int) -> list[str]:
    space = " " * indent
    comment = [
        line for part in task.split("\n") for line in textwrap.wrap(part, WIDTH - indent, break_long_words=False)
    ]
    return [*(f"{space}# {line}" for line in comment), f"{space}raise NotImplementedError"]


def _kept(text: str, names: tuple[str, ...]) -> str:
    """Return the module docstring, the imports used, and the top-level statements with these names."""
    tree, lines = ast.parse(text), text.splitlines()

    def source(node: ast.stmt) -> str:
        return "\n".join(lines[node.lineno - 1 : node.end_lineno])

    kept = [node for node in tree.body if _name(node) in names]
    used = {node.id for statement in kept for node in ast.walk(statement) if isinstance(node, ast.Name)} | {"np"}
    imports = [
        node
        for node in tree.body
        if (isinstance(node, ast.ImportFrom) and (node.module == "__future__" or _imported(node) & used))
        or (isinstance(node, ast.Import) and _imported(node) & used)
    ]
    docstring, *_ = tree.body
    blocks = [source(docstring)] + [source(node) for node in imports if _is_future(node)]
    outside = [source(node) for node in imports if not _is_future(node)]
    constants = [source(node) for node in kept if not isinstance(node, (ast.FunctionDef, ast.ClassDef))]
    functions = [source(node) for node in kept if isinstance(node, (ast.FunctionDef, ast.ClassDef))]
    head = "\n\n".join([*blocks, _in_groups(outside), *(["\n".join(constants)] if constants else [])])
    return "\n\n\n".join([head, *functions]) + "\n"


def _with_numpy(text: str) -> str:
    """Add ``import numpy as np`` if it is missing, for the reader's solution."""
    if "\nimport numpy as np\n" in text:
        return text
    return re.sub(r"^(?=from (netlib|layers)\b)", "import numpy as np\n\n", text, count=1, flags=re.MULTILINE)


def _in_groups(imports: list[str]) -> str:
    """Join imports in three groups (standard library, third-party, project), separated by blank lines."""
    project, others = ("netlib", "layers"), ("numpy", "scipy")
    groups: list[list[str]] = [[], [], []]
    for line in imports:
        package = line.split()[1].split(".")[0]
        groups[2 if package in project else 1 if package in others else 0].append(line)
    return "\n\n".join("\n".join(group) for group in groups if group)


def _is_future(node: ast.stmt) -> bool:
    return isinstance(node, ast.ImportFrom) and node.module == "__future__"


def _imported(node: ast.Import | ast.ImportFrom) -> set[str]:
    return {alias.asname or alias.name.split(".")[0] for alias in node.names}


def _name(node: ast.stmt) -> str:
    if isinstance(node, (ast.FunctionDef, ast.ClassDef)):
        return node.name
    target = node.targets[0] if isinstance(node, ast.Assign) else getattr(node, "target", None)
    return target.id if isinstance(target, ast.Name) else ""


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
    namespace = vars(own_module(exercise.reference.__module__))
    used = {name for thing in own.values() for name in thing.__code__.co_names if name in thing.__globals__}
    return {} if any("super()" in text for text in found.values()) or not used <= namespace.keys() else found
