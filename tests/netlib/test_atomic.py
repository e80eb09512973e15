"""netlib/atomic.py; snapshots, which replace two files together, have tests of their own"""

from __future__ import annotations

from pathlib import Path

import pytest

from netlib import atomic
from netlib.errors import DataError


def test_a_file_is_replaced_whole(tmp_path: Path) -> None:
    """While it is written the old one is there; after it nothing else is."""
    path = tmp_path / "list.txt"
    atomic.replace_text(path, "old")

    def fill(temporary: Path) -> None:
        temporary.write_text("new")
        assert path.read_text() == "old"

    for sync in (True, False):
        path.write_text("old")
        atomic.replace(path, fill, sync)
        assert path.read_text() == "new"
        assert list(tmp_path.iterdir()) == [path]


def test_a_failure_leaves_the_old_one(tmp_path: Path) -> None:
    """And no temporary file."""
    path = tmp_path / "list.txt"
    path.write_text("old")

    def failing(temporary: Path) -> None:
        temporary.write_text("half")
        raise OSError("disk full")

    with pytest.raises(OSError, match="disk full"):
        atomic.replace(path, failing)
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]


def test_text_of(tmp_path: Path) -> None:
    """A missing file is no mistake, an unreadable one is."""
    assert atomic.text_of(tmp_path / "none.txt") is None
    (tmp_path / "list.txt").write_text("ä")
    assert atomic.text_of(tmp_path / "list.txt") == "ä"
    (tmp_path / "list.txt").write_bytes(b"\xff")
    with pytest.raises(DataError, match="not a text file"):
        atomic.text_of(tmp_path / "list.txt")


def test_a_folder_is_not_replaced(tmp_path: Path) -> None:
    """A file cannot take its place, and it is not put aside."""
    (tmp_path / "folder").mkdir()
    with pytest.raises(OSError, match="Is a directory"):
        atomic.replace_all([(tmp_path / "a", b"1"), (tmp_path / "folder", b"2")])
    assert [path.name for path in tmp_path.iterdir()] == ["folder"]
