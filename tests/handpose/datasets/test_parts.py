"""handpose/datasets/parts.py; more of it in the tests of the tools that use it"""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

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
        yield {
            "a": rng.normal(size=(count, 200, 5)).astype(np.float32),
            "b": np.arange(first, first + count),
        }
        yield {"a": np.zeros((0, 200, 5), np.float32), "b": np.zeros(0, np.int64)}


@pytest.mark.parametrize("rows", [0, 1, 100, 130])
def test_rows_in_pieces(tmp_path: Path, rows: int) -> None:
    """A part has the rows of all pieces in order, and its attributes; large arrays
    can be mapped.
    """
    part = Part(tmp_path / "part.h5", 0, 130, "us", "recipe")
    expected = [*pieces(rows), COLUMNS]
    parts.write_part(part, rows, expected, {"more": 5})
    with h5py.File(part.path) as file:
        assert dict(file.attrs) == {"more": 5, "made_from": "us", "recipe": "recipe"}
        for name in "ab":
            np.testing.assert_array_equal(
                file[name][...], np.concatenate([piece[name] for piece in expected])
            )
        assert file["a"].chunks is None and file["a"].compression is None
        assert rows < 100 or file["a"].id.get_offset() % 4096 == 0
    assert [path.name for path in tmp_path.iterdir()] == ["part.h5"]


def test_room(tmp_path: Path) -> None:
    """Insufficient disk space raises an error in MB, also for a folder that does not exist yet;
    files make room.
    """
    for folder in (tmp_path, tmp_path / "new" / "er"):
        parts.check_space(folder, [(1, COLUMNS)])
        with pytest.raises(DataError, match=r"needs 4034214400000000 MB, \d+ MB are free"):
            parts.check_space(folder, [(10**18, COLUMNS)])
    with (tmp_path / "train_000.h5").open("wb") as file:
        file.truncate(10**13)  # without content
    parts.check_space(tmp_path, [(10**9, COLUMNS)])


# ----------------------------------------------------------------------------- what may be replaced

OWN = ("us", '{"skeleton": "ours.prototxt", "seed": 1}')
PART, LIST = "train_001.h5", "train.txt"


@pytest.mark.parametrize(
    ("name", "there", "refused"),
    [
        (PART, ("us", '{"skeleton": "ours.prototxt", "seed": 2}'), ""),
        (PART, ("NYU", "{}"), "holds data made from NYU, expected us frames of ours.prototxt; "),
        (
            PART,
            ("us", '{"skeleton": "arm.prototxt"}'),
            "holds data made from us frames of arm.prototxt, expected us ",
        ),
        (
            PART,
            (None, OWN[1][:-1]),
            "holds data made from an unknown source frames of ours.prototxt, expected ",
        ),
        (PART, ("us", [1, 2]), "holds data made from us, expected us frames of ours.prototxt; "),
        (PART, "notes", "not a readable HDF5 file; "),
        (LIST, " \n", ""),
        (LIST, "elsewhere/train_000.h5\ntrain_012.h5\n", ""),
        (LIST, "train_000.h5\nprecious.h5\n", "names 'precious.h5', expected train_000.h5, ...; "),
        (LIST, "a\0" + "x" * 5000, "names 'a\\x00x"),
    ],
    ids=range(10),
)
def test_other_files_are_replaced_only_with_force(
    tmp_path: Path, name: str, there: Any, refused: str
) -> None:
    """A part of the same source and body and a list of parts are replaced, anything else only
    with ``force``.
    """
    wanted = parts.parts_of(tmp_path, "train", 3000, OWN[0], lambda start, rows: json.loads(OWN[1]))
    lists = [tmp_path / "train.txt", tmp_path / "test.txt"]
    assert parts.missing_of(wanted, lists) == wanted
    if isinstance(there, str):
        (tmp_path / name).write_text(there)
    else:
        with h5py.File(tmp_path / name, "w") as file:
            file.attrs.update(
                {key: value for key, value in zip(("made_from", "recipe"), there) if value}
            )
    if refused:
        with pytest.raises(DataError) as error:
            parts.missing_of(wanted, lists)
        assert str(error.value).startswith(f"{tmp_path / name}: {refused}")
        assert "\n" not in str(error.value)
        assert str(error.value).endswith("; choose another --out, or use --force to replace it")
    assert parts.missing_of(wanted, lists, force=bool(refused)) == wanted


def test_parts_with_their_recipe_are_kept(tmp_path: Path) -> None:
    first, last = wanted = parts.parts_of(
        tmp_path, "train", 2600, "us", lambda start, rows: {"first": start}
    )
    assert [part.path.name for part in wanted] == ["train_000.h5", "train_001.h5"]
    assert (last.start, last.rows) == (2500, 100)
    assert json.loads(last.recipe) == {"first": 2500, "start": 2500, "frames": 100}
    parts.write_part(last, 100, pieces(100), {})
    assert parts.missing_of(wanted, []) == [first]
    assert parts.missing_of(wanted, [], force=True) == wanted


@pytest.mark.parametrize("force", [False, True])
@pytest.mark.parametrize("name", ["train_000.h5", "train.txt"])
def test_folders_are_never_replaced(tmp_path: Path, name: str, force: bool) -> None:
    (tmp_path / name).mkdir()
    wanted = parts.parts_of(tmp_path, "train", 1, "us", lambda start, rows: {})
    with pytest.raises(DataError, match=rf"/{name}: is not a file; move it away"):
        parts.missing_of(wanted, [tmp_path / "train.txt"], force)
