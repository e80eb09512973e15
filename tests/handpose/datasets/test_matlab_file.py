"""Variables of a MATLAB file: numbers, or an error of one line, even if the file crashes the process that reads it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.io

from handpose.datasets import matlab_file
from handpose.datasets.matlab_file import read_variables
from netlib.errors import DataError
from tests.support.bad_input import bad_inputs


@pytest.fixture
def path(tmp_path: Path) -> Path:
    """A file with an array of four axes, a matrix, a text, and a cell of objects."""
    cell = np.empty((1, 1), object)
    cell[0, 0] = "x"
    variables = {"joints": np.arange(24.0).reshape(2, 3, 2, 2), "table": np.eye(2), "word": "NYU", "cell": cell}
    scipy.io.savemat(tmp_path / "a.mat", variables)
    return tmp_path / "a.mat"


def test_numbers_and_words(path: Path) -> None:
    """Of an array of four axes the first item is read; optional variables may be missing."""
    found = read_variables(path, ("joints", "table"), ("word", "nothing"))
    assert sorted(found) == ["joints", "table", "word"]
    assert np.array_equal(found["joints"], np.arange(12.0).reshape(1, 3, 2, 2))
    assert np.array_equal(found["table"], np.eye(2))
    assert str(np.ravel(found["word"])[0]) == "NYU"


@bad_inputs(DataError, {
    "nose": (("", 60.0), "...a.mat: no variable 'nose'; it has cell, joints, table, word"),
    "cell": (("", 60.0), "...a.mat: cell is object of shape (1, 1), expected numbers"),
    "crash": (("import os, signal; os.kill(os.getpid(), signal.SIGSEGV)", 60.0),
              "...a.mat: damaged: SciPy's reader crashes on it (status -11)"),
    "hang": (("import signal; signal.pause()", 0.1),
             "...a.mat: damaged: SciPy's reader does not come to an end with it"),
})
def test_what_cannot_be_read(
    path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, request: Any, given: tuple[str, float], rejected: Any
) -> None:
    """Missing variables, objects, and a file that crashes or blocks the reading process are errors of one line."""
    worker, seconds = given
    if worker:
        (tmp_path / "worker.py").write_text(worker)
        monkeypatch.setattr(matlab_file, "WORKER", tmp_path / "worker.py")
        monkeypatch.setattr(matlab_file, "SECONDS", seconds)
    name = request.node.callspec.id
    with rejected:
        read_variables(path, ("table", name) if name == "nose" else ("cell" if name == "cell" else "table",))
