"""netlib/files/atomic.py. Snapshots, which replace two files together, have separate tests."""

from __future__ import annotations

import os
import re
import secrets
from collections.abc import Callable
from pathlib import Path

import pytest

from netlib.files import atomic


def test_a_file_is_replaced_whole(tmp_path: Path) -> None:
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
    path = tmp_path / "list.txt"
    path.write_text("old")

    def failing(temporary: Path) -> None:
        temporary.write_text("half")
        raise OSError("disk full")

    with pytest.raises(OSError, match=r"disk full: '.*list\.txt'$"):
        atomic.replace(path, failing)
    with pytest.raises(KeyboardInterrupt), atomic.replacing(path) as temporary:
        temporary.write_text("half")
        raise KeyboardInterrupt
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]


def test_text_of(tmp_path: Path) -> None:
    assert atomic.text_of(tmp_path / "none.txt") is None
    (tmp_path / "list.txt").write_text("ä")
    assert atomic.text_of(tmp_path / "list.txt") == "ä"


@pytest.mark.parametrize("name", ["", ".", "..", "/", "folder"])
def test_a_folder_is_not_replaced(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("folder").mkdir()
    for write, content in ((atomic.replace_bytes, b"1"), (atomic.replace_text, "1")):
        with pytest.raises(OSError, match=f"Is a directory: '{re.escape(str(Path(name)))}'$"):
            write(Path(name), content)
    assert [path.name for path in tmp_path.iterdir()] == ["folder"]


def test_a_planted_link_is_not_followed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A symbolic link with the name of the temporary file is not followed, even if the
    random part matches.
    """
    (tmp_path / "precious").write_text("mine")
    monkeypatch.setattr(secrets, "token_hex", lambda count: "0123abcd")
    (tmp_path / ".w.0123abcd.netlib.tmp").symlink_to(tmp_path / "precious")
    with pytest.raises(FileExistsError):
        atomic.replace_bytes(tmp_path / "w", b"new")
    assert (tmp_path / "precious").read_text() == "mine"


def test_leftovers_of_a_killed_process_are_removed(tmp_path: Path) -> None:
    for name in (".w_iter_5.h5.0123abcd.netlib.tmp", ".w_iter_10.h5.89abcdef.netlib.tmp"):
        (tmp_path / name).write_text("left")
    others = [".w_iter_5.h5.tmp", ".x_iter_5.h5.0123abcd.netlib.tmp", "w_iter_5.h5"]
    for name in others:
        (tmp_path / name).write_text("of others")
    atomic.clear_leftovers(tmp_path, re.compile(r"w_iter_\d+\.h5"))
    assert {path.name for path in tmp_path.iterdir()} == set(others)


@pytest.mark.parametrize(
    "write", [atomic.replace_bytes, lambda path, content: atomic.replace(path, Path.touch)]
)
def test_a_pipe_is_not_replaced(tmp_path: Path, write: Callable[[Path, bytes], None]) -> None:
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(OSError, match=r"it is a device or a pipe; expected a .*file: '.*pipe'"):
        write(tmp_path / "pipe", b"new")
    assert (tmp_path / "pipe").is_fifo()
    assert [path.name for path in tmp_path.iterdir()] == ["pipe"]
