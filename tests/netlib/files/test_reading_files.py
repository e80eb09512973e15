"""netlib/files/reading.py: a user's file is read whole, or a one-line error is raised."""

from __future__ import annotations

import errno
import os
import re
import socket
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from netlib import files
from netlib.errors import DataError, NetlibError, WeightsError, printable
from netlib.files import atomic, reading
from tests.support.bad_input import bad_inputs


def test_bytes_and_text(here: Path) -> None:
    """read_text removes a byte order mark and normalizes line ends; read_bytes returns the
    bytes unchanged.
    """
    path = Path("a.txt")
    path.write_bytes(b"\xef\xbb\xbfone\r\ntwo\r\xc3\xa4")
    assert files.read_text(path, "the list") == "one\ntwo\nä"
    assert files.read_bytes(path, "the list")[:6] == b"\xef\xbb\xbfone"
    assert files.read_bytes(path, "the list", first=3) == b"\xef\xbb\xbf"


@bad_inputs(
    DataError,
    {
        "large text": (
            lambda at: files.read_text(at / "hole", "the list"),
            ".../hole: 10000000000 bytes, which is too large for the list; at most 268435456 are read",
        ),
        "no text": (
            lambda at: files.read_text(at / "bytes", "the log"),
            ".../bytes: cannot read the log: not a text file (byte 3 is not UTF-8)",
        ),
        "no UTF-8": (
            lambda at: atomic.text_of(at / "bytes"),
            ".../bytes: cannot read the text: not a text file (byte 3 is not UTF-8)",
        ),
        "a file as a folder": (
            lambda at: files.make_folder(at / "bytes"),
            NetlibError,
            ".../bytes: is a file; expected a folder",
        ),
        "a file above": (
            lambda at: files.make_folder(at / "bytes/a/b"),
            NetlibError,
            ".../bytes: is a file; expected a folder",
        ),
        "device": (
            lambda at: files.make_folder(Path("/dev/null")),
            NetlibError,
            "/dev/null: is a device; expected a folder",
        ),
        "a link to itself": (
            lambda at: files.make_folder(at / "loop"),
            OSError,
            "[Errno 17] File exists: '.../loop'",
        ),
    },
)
def test_unreadable_files_are_rejected(
    here: Path, given: Callable[[Path], object], rejected: Any
) -> None:
    Path("bytes").write_bytes(b"abc\xff")
    Path("loop").symlink_to("loop")
    with Path("hole").open("wb") as file:
        file.truncate(10**10)  # takes no disk space
    with rejected:
        given(here)


def test_the_start_of_a_large_file_and_text_with_errors(here: Path) -> None:
    with Path("hole").open("wb") as file:
        file.truncate(10**10)
    assert files.read_bytes("hole", "the list", first=2) == b"\0\0"
    Path("a").write_bytes(b"abc\xff")
    assert files.read_text("a", "the log", errors="replace") == "abc\ufffd"


def test_folders_are_made(here: Path) -> None:
    for _ in range(2):
        files.make_folder(Path("a/b"))
    assert Path("a/b").is_dir()


def test_noted_collects_the_files_read_within_its_block(here: Path) -> None:
    """Also in nested blocks, but not failed reads or later ones."""
    for name in "ab":
        Path(name).write_text(name)
    with files.noted() as outer:
        files.read_text(Path("a"), "the list")
        with files.noted() as inner, pytest.raises(DataError):
            files.read_text(Path("b"), "the list")
            files.read_text(Path("none"), "the list")
    files.read_text(Path("a"), "the list")
    assert outer == [Path("a"), Path("b")]
    assert inner == [Path("b")]


def kinds_in(folder: Path) -> dict[str, str]:
    """Map names of things that are not files to error patterns; Python 3.13 rewords the error
    for a null byte.
    """
    os.mkfifo(folder / "pipe")
    (folder / "folder").mkdir()
    with socket.socket(socket.AF_UNIX) as server:
        server.bind(str(folder / "socket"))
    return {
        str(folder / "pipe"): "it is a pipe; expected a file",
        str(folder / "folder"): "Is a directory; expected a file",
        str(folder / "socket"): "it is a socket; expected a file",
        str(folder / "none"): "No such file or directory",
        str(folder / "a\0b"): ".*embedded null (byte|character in path)",
        str(folder / ("x" * 300)): "File name too long",
        "/dev/zero": "it is a device; expected a file",
    }


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="there are no pipes with names here")
def test_anything_but_a_regular_file_is_rejected(
    here: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Reading does not wait for the writer of a pipe and does not read an endless device."""
    for name, reason in kinds_in(Path()).items():
        for read in (files.read_bytes, files.read_text, files.opened):
            with pytest.raises(WeightsError) as error:
                read(name, "weights", WeightsError)
            assert re.fullmatch(
                re.escape(printable(f"{name}: cannot read weights: ")) + reason, str(error.value)
            )


@pytest.mark.skipif(not Path("/proc/self/pagemap").is_file(), reason="no file without an end here")
def test_a_file_without_an_end() -> None:
    """A file that reports size 0 is read as empty; /proc/self/pagemap would return
    data without end.
    """
    pagemap = "/proc/self/pagemap"
    assert (
        files.read_bytes(pagemap, "weights") == files.read_bytes(pagemap, "weights", first=8) == b""
    )


@pytest.mark.parametrize("positioned", [True, False], ids=["with preadv", "without"])
def test_a_source(here: Path, monkeypatch: pytest.MonkeyPatch, positioned: bool) -> None:
    if not positioned:
        monkeypatch.delattr(os, "preadv", raising=False)
    path = Path("a")
    path.write_bytes(bytes(range(100)))
    source = files.Source(path, "the data")
    assert (source.size, source.read(0, 3), source.read(97, 3)) == (
        100,
        b"\0\1\2",
        bytes((97, 98, 99)),
    )
    with pytest.raises(DataError, match=f"^{path}: ends at byte 100, expected 101"):
        source.read(98, 3)
    with pytest.raises(
        DataError, match=f"^{path}: cannot read the data: no memory for {1 << 60} bytes"
    ):
        source.read(0, 1 << 60)
    os.truncate(path, 50)
    with pytest.raises(
        DataError, match=f"^{path}: was cut to 50 of 100 bytes while in use; restore the file"
    ):
        source.read(98, 2)


def test_a_removed_source_is_a_data_error(here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A file may be removed on a network drive; a training run can then write a snapshot."""
    Path("a").write_bytes(bytes(100))
    source = files.Source("a", "the data")

    def stale(descriptor: int) -> tuple[int, ...]:
        raise OSError(errno.ESTALE, os.strerror(errno.ESTALE))

    monkeypatch.setattr(reading, "_identity", stale)
    with pytest.raises(DataError, match=r"^a: cannot read the data: Stale file handle$"):
        source.check()


@pytest.mark.skipif(not hasattr(os, "preadv"), reason="no reads that leave a file's position alone")
def test_a_source_in_two_processes(here: Path) -> None:
    """Reads do not move the file's position, which forked processes share."""
    Path("a").write_bytes(bytes(100))
    source = files.Source("a", "the data")
    source.read(20, 30)
    assert source._stream.tell() == 0


def test_a_place_is_added_to_an_error_of_data() -> None:
    """To no other error, and without the error that had no place."""
    with pytest.raises(DataError, match=r"^a\.h5: too short$") as raised, reading.located("a.h5"):
        raise DataError("too short")
    assert raised.value.__suppress_context__
    with pytest.raises(NetlibError, match=r"^too short$"), reading.located("a.h5"):
        raise NetlibError("too short")
