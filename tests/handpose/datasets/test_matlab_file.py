"""Variables of a MATLAB file: numbers, or an error of one line, even if the file crashes the process that reads it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import scipy.io

from handpose.datasets import matlab_file
from handpose.datasets.matlab_file import read_variables
from netlib.errors import DataError


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


def test_what_is_not_there(path: Path) -> None:
    """The error names the missing variable and those in the file."""
    with pytest.raises(DataError, match=r"a\.mat: no variable 'nose'; it has cell, joints, table, word"):
        read_variables(path, ("table", "nose"))


def test_objects_are_no_numbers(path: Path) -> None:
    """A variable of objects raises an error, because it would have to be unpickled."""
    with pytest.raises(DataError, match=r"a\.mat: cell is object of shape \(1, 1\), expected numbers"):
        read_variables(path, ("cell",))


def test_a_file_that_ends_its_reader(path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A file that crashes the reading process raises an error of one line."""
    (tmp_path / "crash.py").write_text("import os, signal; os.kill(os.getpid(), signal.SIGSEGV)")
    monkeypatch.setattr(matlab_file, "WORKER", tmp_path / "crash.py")
    with pytest.raises(DataError, match=r"a\.mat: damaged: SciPy's reader crashes on it \(status -11\)"):
        read_variables(path, ("table",))


def test_a_file_that_keeps_its_reader(path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A file on which the reading process hangs raises an error of one line."""
    (tmp_path / "hang.py").write_text("import signal; signal.pause()")
    monkeypatch.setattr(matlab_file, "WORKER", tmp_path / "hang.py")
    monkeypatch.setattr(matlab_file, "SECONDS", 0.1)
    with pytest.raises(DataError, match=r"a\.mat: damaged: SciPy's reader does not come to an end with it"):
        read_variables(path, ("table",))
