"""netlib/files/atomic.py. Snapshots, which replace two files together, have separate tests."""

from __future__ import annotations

import contextlib
import os
import secrets
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from netlib.files import atomic, locks


def test_a_file_is_replaced_whole(tmp_path: Path) -> None:
    """The old file exists while the new one is written, and no temporary file remains."""
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
    """A failed or interrupted write keeps the old file and leaves no temporary file."""
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
    """A missing file gives None."""
    assert atomic.text_of(tmp_path / "none.txt") is None
    (tmp_path / "list.txt").write_text("ä")
    assert atomic.text_of(tmp_path / "list.txt") == "ä"


def test_a_folder_is_not_replaced(tmp_path: Path) -> None:
    """A folder cannot be replaced by a file, and then neither file of a pair is written."""
    (tmp_path / "folder").mkdir()
    with pytest.raises(OSError, match=r"Is a directory.*folder'$"):
        atomic.replace_pair((tmp_path / "a", b"1"), (tmp_path / "folder", b"2"))
    with pytest.raises(OSError, match=r"Is a directory.*folder'$"):
        atomic.replace_bytes(tmp_path / "folder", b"2")
    assert [path.name for path in tmp_path.iterdir()] == ["folder"]


@pytest.mark.parametrize("name", ["", ".", "..", "/"])
def test_what_is_no_name_of_a_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str) -> None:
    """A name that is not a file name raises an OSError and writes nothing."""
    monkeypatch.chdir(tmp_path)
    pairs: list[Callable[[], object]] = [
        lambda: atomic.replace_bytes(Path(name), b"1"),
        lambda: atomic.replace_text(Path(name), "1"),
        lambda: atomic.replace_pair((Path("a"), b"1"), (Path(name), b"2")),
    ]
    for write in pairs:
        with pytest.raises(OSError, match=r"Is a directory.*'"):
            write()
    assert list(tmp_path.iterdir()) == []


def test_a_link_that_somebody_planted_is_not_followed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A symbolic link with the name of the temporary file is not followed, even if the random part matches."""
    (tmp_path / "precious").write_text("mine")
    monkeypatch.setattr(secrets, "token_hex", lambda count: "0123abcd")
    (tmp_path / ".w.0123abcd.netlib.tmp").symlink_to(tmp_path / "precious")
    with pytest.raises(FileExistsError):
        atomic.replace_bytes(tmp_path / "w", b"new")
    assert (tmp_path / "precious").read_text() == "mine"


def test_what_a_killed_process_left_is_cleared_and_what_a_living_one_writes_is_not(tmp_path: Path) -> None:
    """Temporary files and folders of ended processes are removed; other names and files in use are kept."""
    (tmp_path / ".w.h5.0123abcd.netlib.tmp").write_text("left")
    (tmp_path / ".database.89abcdef.netlib.tmp").mkdir()
    (tmp_path / ".database.89abcdef.netlib.tmp" / "data.mdb").write_text("left")
    others = [".w.h5.tmp", ".w.h5.0123abcd.netlib", "w.h5.0123abcd.netlib.tmp", ".w.h5.0123abcd.netlib.old"]
    for name in others:
        (tmp_path / name).write_text("not ours")
    with atomic.temporary(tmp_path / "living") as fresh, atomic.temporary_folder(tmp_path / "folder") as folder:
        atomic.clear_leftovers(tmp_path)
        assert {path.name for path in tmp_path.iterdir()} == {*others, fresh.name, folder.name}
    assert {path.name for path in tmp_path.iterdir()} == set(others)


def test_a_name_taken_for_a_leftover_before_it_was_locked(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """If another process removes the temporary file before it is locked, a new one is created."""
    held, calls = locks.held, []

    @contextlib.contextmanager
    def late(path: Path) -> Iterator[bool | None]:
        calls.append(path)
        if len(calls) == 1:
            path.unlink()
        with held(path) as locked:
            yield locked

    monkeypatch.setattr(locks, "held", late)
    atomic.replace_bytes(tmp_path / "w", b"new")
    assert len(calls) == 2
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == {"w": b"new"}


def test_a_name_whose_lock_another_has(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """If another process holds the lock of the temporary file, it may remove it, so a new one is created."""
    held, calls = locks.held, []

    @contextlib.contextmanager
    def taken(path: Path) -> Iterator[bool | None]:
        calls.append(path)
        with held(path) as locked:
            yield locked if len(calls) > 1 else False
        if len(calls) == 1:
            path.unlink()

    monkeypatch.setattr(locks, "held", taken)
    atomic.replace_bytes(tmp_path / "w", b"new")
    assert len(calls) == 2
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == {"w": b"new"}


@pytest.mark.parametrize("write", [atomic.replace_bytes, lambda path, content: atomic.replace(path, Path.touch)])
def test_a_pipe_is_not_taken_away(tmp_path: Path, write: Callable[[Path, bytes], None]) -> None:
    """A pipe or a device is not replaced by a file."""
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(OSError, match=r"it is a device or a pipe; expected a .*file: '.*pipe'"):
        write(tmp_path / "pipe", b"new")
    assert (tmp_path / "pipe").is_fifo()
    assert [path.name for path in tmp_path.iterdir()] == ["pipe"]
