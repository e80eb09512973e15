"""Stubs are the project's source without the bodies, and the recorded numbers are Caffe's, bit for bit."""

from __future__ import annotations

import ast
from pathlib import Path

import numpy as np
import pytest

from exercises import recorded
from exercises.exercise import Exercise
from exercises.stubs import stub
from exercises.table import EXERCISES
from tests.exercises import reduce_recordings
from tests.tools.conftest import ROOT

exercises = pytest.mark.parametrize("exercise", EXERCISES.values(), ids=list(EXERCISES))


def functions(text: str) -> dict[str, ast.FunctionDef]:
    """Return every function and method by name."""
    return {node.name: node for node in ast.walk(ast.parse(text)) if isinstance(node, ast.FunctionDef)}


@exercises
def test_a_stub_is_our_source_without_the_bodies(exercise: Exercise) -> None:
    """Docstring, signatures and given code of a stub are the project's; nothing of a body to be written remains."""
    text, ours = stub(exercise), (ROOT / exercise.file).read_text(encoding="utf-8")
    assert ast.get_docstring(ast.parse(text)) == ast.get_docstring(ast.parse(ours))
    wanted = {name.split(".")[-1] for name in exercise.to_do}
    mine, theirs = functions(text), functions(ours)
    assert set(mine) <= set(theirs)
    assert exercise.keep or set(mine) == set(theirs)
    for name, function in mine.items():
        if name in wanted:
            assert ast.unparse(function.args) == ast.unparse(theirs[name].args)
            assert ast.get_docstring(function) == ast.get_docstring(theirs[name])
            body = function.body[1:] if ast.get_docstring(function) else function.body
            assert [ast.unparse(line) for line in body] == ["raise NotImplementedError"]
        else:
            assert ast.unparse(function) == ast.unparse(theirs[name])


@exercises
def test_a_stub_says_what_is_to_be_done(exercise: Exercise) -> None:
    """Comments in the stub describe the task, its first line describes the next step, and np is imported."""
    text = stub(exercise)
    first = f"# Replace each NotImplementedError, then run: python tools/exercise.py {exercise.name}"
    assert text.splitlines()[0] == first
    assert "\nimport numpy as np\n" in text
    words = " ".join(line.strip().lstrip("# ") for line in text.splitlines())
    for task in exercise.to_do.values():
        assert " ".join(task.split()) in words
    assert max(map(len, text.splitlines())) <= 120


def test_the_recorded_numbers_are_caffes(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """The recorded numbers are reproduced from tests/caffe, bit for bit, and are few enough to be installed."""
    mine, size = recorded.everything(), recorded.FILE.stat().st_size
    monkeypatch.setattr(recorded, "FILE", tmp_path / "again.npz")
    assert reduce_recordings.main() == 0
    theirs = np.load(tmp_path / "again.npz")
    assert mine.keys() == theirs.keys()
    for name, array in theirs.items():
        assert mine[name].dtype == array.dtype
        assert np.array_equal(mine[name], array), name
    assert size < 160_000
