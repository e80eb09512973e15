"""handpose/datasets/parts.py; more of it in the tests of the tools that use it"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import h5py
import numpy as np
import pytest

from handpose.datasets import parts
from handpose.datasets.parts import Part
from netlib.errors import DataError

COLUMNS = {"a": np.zeros((0, 200, 5), np.float32), "b": np.zeros((0,), np.int64)}


def pieces(rows: int) -> Iterator[dict[str, np.ndarray]]:
    """Rows in pieces of 30, separated by empty pieces."""
    rng = np.random.default_rng(0)
    for first in range(0, rows, 30):
        count = min(30, rows - first)
        yield {"a": rng.normal(size=(count, 200, 5)).astype(np.float32), "b": np.arange(first, first + count)}
        yield {"a": np.zeros((0, 200, 5), np.float32), "b": np.zeros(0, np.int64)}


@pytest.mark.parametrize("rows", [0, 1, 100, 130])
def test_fewer_rows_than_expected(tmp_path: Path, rows: int) -> None:
    """A part with fewer rows than expected has their number of rows, and the attributes as of the end of writing."""
    part = Part(tmp_path / "part.h5", 130, "recipe")
    read = []

    def counted() -> Iterator[dict[str, np.ndarray]]:
        for piece in pieces(rows):
            read.extend(piece["b"])
            yield piece

    assert parts.write_part(part, COLUMNS, counted(), lambda: {"read": len(read)}) == rows
    with h5py.File(part.path) as file:
        assert dict(file.attrs) == {"read": rows, "recipe": "recipe"}
        expected = [piece for piece in pieces(rows) if len(piece["b"])]
        for name in "ab":
            whole = np.concatenate([piece[name] for piece in expected]) if expected else COLUMNS[name]
            np.testing.assert_array_equal(file[name][...], whole)
    assert [path.name for path in tmp_path.iterdir()] == ["part.h5"]
    assert parts.is_whole(part) and not parts.is_whole(Part(part.path, 130, "another"))


def test_a_failure_leaves_nothing(tmp_path: Path) -> None:
    def failing() -> Iterator[dict[str, np.ndarray]]:
        yield from pieces(30)
        raise DataError("no more")

    (tmp_path / "part.h5").write_text("before")
    with pytest.raises(DataError, match="no more"):
        parts.write_part(Part(tmp_path / "part.h5", 60, ""), COLUMNS, failing(), dict)
    assert [path.name for path in tmp_path.iterdir()] == ["part.h5"]
    assert (tmp_path / "part.h5").read_text() == "before"


def test_room(tmp_path: Path) -> None:
    """Insufficient disk space raises an error in MB, also for a folder that does not exist yet."""
    for folder in (tmp_path, tmp_path / "new" / "er"):
        parts.check_room(folder, 1)
        with pytest.raises(DataError, match=r"needs 1000000000000 MB, \d+ MB are free"):
            parts.check_room(folder, 10**18)
    with pytest.raises(DataError, match=r"needs 10+ MB"):
        parts.check_room(tmp_path, 10**400)


@pytest.fixture
def ours(tmp_path: Path) -> Path:
    """The file data/a.h5, whose attribute ``made_from`` is ours."""
    (tmp_path / "data").mkdir()
    with h5py.File(tmp_path / "data" / "a.h5", "w") as file:
        file.attrs["made_from"] = "us"
    return tmp_path / "data" / "a.h5"


@pytest.mark.parametrize("line", ["{folder}/a.h5", "a.h5", "data/a.h5", "data/b.h5", ""])
def test_our_own_list(ours: Path, line: str) -> None:
    """A list that names our own files may be replaced, relative to any folder, also if the files are missing."""
    (ours.parent / "list.txt").write_text(line.format(folder=ours.parent) + "\n")
    parts.refuse_foreign([ours, ours.with_name("b.h5")], [ours.parent / "list.txt"], ["us"])


@pytest.mark.parametrize("line", ["precious", "real/a.h5", "/gone/a.h5", "c.h5", "a\0.h5", "x" * 5000])
def test_a_list_of_others(ours: Path, line: str) -> None:
    """A list of other files, or a file that is not a list, is replaced only with ``force``."""
    given = [ours, ours.with_name("b.h5")], [ours.parent / "list.txt"], ["us"]
    (ours.parent / "list.txt").write_text(f"a.h5\n{line}\n")
    with pytest.raises(DataError, match=r"list.txt: names .*, which is not there; .* or use --force") as error:
        parts.refuse_foreign(*given)
    assert "\n" not in str(error.value)
    parts.refuse_foreign(*given, force=True)


@pytest.mark.parametrize("force", [False, True])
@pytest.mark.parametrize("name", ["a.h5", "list.txt"])
def test_folders_are_never_replaced(tmp_path: Path, name: str, force: bool) -> None:
    (tmp_path / name).mkdir()
    with pytest.raises(DataError, match=rf"/{name}: is not a file; move it away"):
        parts.refuse_foreign([tmp_path / "a.h5"], [tmp_path / "list.txt"], ["us"], force)
