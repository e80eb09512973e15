"""Every name in the instructions, hints and advice of an exercise exists where the
student works.
"""

from __future__ import annotations

import ast
import importlib
import inspect
import re
from collections.abc import Iterator
from types import ModuleType

import pytest

from exercises.exercise import Exercise
from exercises.table import EXERCISES

ITEM = r"(?:\[[^\]]*\])?"
DOTTED = rf"[A-Za-z_]\w*{ITEM}(?:\.[A-Za-z_]\w*{ITEM})+"
NAME = re.compile(rf"{DOTTED}|\b\w*_\w*|[A-Za-z_]\w*(?=\()")
# an option of PyTorch, a value in a skeleton file, and an option of all layers
ELSEWHERE = {"count_include_pad", "NEG_Y", "loss_weight"}


def names_in(text: str) -> Iterator[list[str]]:
    """The parts of each dotted, underscored or called name: ["snapshot", "weights_of"]."""
    for name in NAME.findall(text):
        yield re.sub(r"\[[^\]]*\]", "", name).split(".")


def words_of(module: ModuleType) -> set[str]:
    """The words of a module: its identifiers, the symbols of its formulas, its options."""
    return set(re.findall(r"\w+", inspect.getsource(module)))


def imported_by(module: ModuleType) -> Iterator[ModuleType]:
    """The modules of this project that a module imports."""
    tree = ast.parse(inspect.getsource(module))
    names = [node.module or "" for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)]
    return (
        importlib.import_module(name) for name in names if name.startswith(("layers.", "netlib."))
    )


def is_known(parts: list[str], module: ModuleType, words: set[str]) -> bool:
    """Whether a name exists: on the object that it starts from, or among the words of the source
    and its imports.
    """
    found = module
    for part in parts if hasattr(module, parts[0]) else ():
        if not hasattr(found, part):
            return False
        found = getattr(found, part)
    return set(parts) <= words | ELSEWHERE


def unknown(exercise: Exercise, text: str) -> list[str]:
    module = importlib.import_module(exercise.file.removesuffix(".py").replace("/", "."))
    words = words_of(module).union(*map(words_of, imported_by(module)))
    return [".".join(parts) for parts in names_in(text) if not is_known(parts, module, words)]


@pytest.mark.parametrize("exercise", EXERCISES.values(), ids=list(EXERCISES))
def test_each_name_exists_where_the_student_works(exercise: Exercise) -> None:
    checks = [f"{check.option} {check.hint}" for check in exercise.checks]
    advice = [mistake.advice for mistake in exercise.mistakes]
    texts = [*exercise.to_do, *exercise.to_do.values(), *checks, *advice]
    assert [name for text in texts for name in unknown(exercise, text)] == []
