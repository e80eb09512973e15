"""netlib/files/reading.py: a user's file is read whole, or a one-line error is raised."""

from __future__ import annotations

import errno
import os
import re
import socket
from pathlib import Path

import pytest

from netlib import files
from netlib.errors import DataError, NetlibError, WeightsError, printable
from netlib.files import reading


def test_bytes_and_text(tmp_path: Path) -> None:
    """read_text removes a byte order mark and normalizes line ends; read_bytes returns the bytes unchanged."""
    path = tmp_path / "a.txt"
    path.write_bytes(b"\xef\xbb\xbfone\r\ntwo\r\xc3\xa4")
    assert files.read_text(path, "the list") == "one\ntwo\nä"
    assert files.read_bytes(path, "the list")[:6] == b"\xef\xbb\xbfone"
    assert files.read_bytes(path, "the list", first=3) == b"\xef\xbb\xbf"


def test_a_git_lfs_pointer_is_named(tmp_path: Path) -> None:
    """Every way of reading rejects the small text that stands for a file in a clone without Git LFS."""
    path = tmp_path / "net.prototxt"
    path.write_text(f"version https://git-lfs.github.com/spec/v1\noid sha256:{'a' * 64}\nsize 123\n")
    for read in (
        lambda: files.read_text(path, "the net"),
        lambda: files.read_bytes(path, "the net", first=2),
        lambda: files.read_content(path, "the net"),
        lambda: list(files.read_pieces(path, "the net")),
        lambda: reading.Source(path, "the net"),
    ):
        with pytest.raises(DataError, match=r"net\.prototxt: cannot read the net: it is a Git LFS pointer"):
            read()


def test_folders_are_made(tmp_path: Path) -> None:
    """make_folder creates parent folders; an error names a file or device in the way."""
    for _ in range(2):
        files.make_folder(tmp_path / "a" / "b")
    (tmp_path / "file").touch()
    for place, what in (("file", "is a file"), ("file/a/b", "is a file"), ("/dev/null", "is a device")):
        with pytest.raises(NetlibError, match=rf"(/file|^/dev/null): {what}; expected a folder$"):
            files.make_folder(tmp_path / place)
    (tmp_path / "loop").symlink_to("loop")
    with pytest.raises(OSError, match="loop"):
        files.make_folder(tmp_path / "loop")


def test_what_is_read_within_a_block_is_noted(tmp_path: Path) -> None:
    """noted collects the files read within the block, also in nested blocks, but not failed reads or later ones."""
    for name in "ab":
        (tmp_path / name).write_text(name)
    with files.noted() as outer:
        files.read_text(tmp_path / "a", "the list")
        with files.noted() as inner, pytest.raises(DataError):
            files.read_text(tmp_path / "b", "the list")
            files.read_text(tmp_path / "none", "the list")
    files.read_text(tmp_path / "a", "the list")
    assert outer == [tmp_path / "a", tmp_path / "b"] and inner == [tmp_path / "b"]


def kinds_in(folder: Path) -> dict[str, str]:
    """Map names of things that are not files to error patterns; Python 3.13 rewords the error for a null byte."""
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
def test_what_is_no_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Reading does not wait for the writer of a pipe and does not read an endless device."""
    monkeypatch.chdir(tmp_path)  # the path of a socket must be short
    for name, reason in kinds_in(Path()).items():
        for read in (files.read_bytes, files.read_text, files.opened):
            with pytest.raises(WeightsError) as error:
                read(name, "weights", WeightsError)
            assert re.fullmatch(re.escape(printable(f"{name}: cannot read weights: ")) + reason, str(error.value))


def test_a_file_that_is_too_large(tmp_path: Path) -> None:
    """The size is checked before the file is read; a sparse file of 10 GB takes no disk space."""
    with (tmp_path / "hole").open("wb") as file:
        file.truncate(10**10)
    with pytest.raises(DataError, match=r"hole: 10000000000 bytes, which is too large for the list; at most 2684"):
        files.read_text(tmp_path / "hole", "the list")
    with pytest.raises(DataError, match=r"hole: 10000000000 bytes, which is too large for weights; at most 2147483647"):
        next(files.read_pieces(tmp_path / "hole", "weights"))
    assert files.read_bytes(tmp_path / "hole", "the list", first=2) == b"\0\0"


@pytest.mark.skipif(not Path("/proc/self/pagemap").is_file(), reason="no file without an end here")
def test_a_file_without_an_end() -> None:
    """A file that reports size 0 is read as empty; /proc/self/pagemap would return data without end."""
    pagemap = "/proc/self/pagemap"
    assert files.read_bytes(pagemap, "weights") == files.read_bytes(pagemap, "weights", first=8) == b""
    assert list(files.read_pieces(pagemap, "weights")) == []


def test_a_file_in_pieces(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """read_pieces stops at the size that the file had when it was opened."""
    path = tmp_path / "a"
    path.write_bytes(b"abcdefg")
    monkeypatch.setattr(reading, "PIECE", 3)
    pieces = files.read_pieces(path, "weights")
    assert next(pieces) == b"abc"
    with path.open("ab") as file:
        file.write(b"hij")
    assert list(pieces) == [b"def", b"g"]
    with pytest.raises(WeightsError, match="none: cannot read weights: No such file"):
        next(files.read_pieces(tmp_path / "none", "weights", WeightsError))


def test_what_is_no_text(tmp_path: Path) -> None:
    """Text that is not UTF-8 raises an error with the byte, unless ``errors`` replaces it."""
    (tmp_path / "a").write_bytes(b"abc\xff")
    with pytest.raises(DataError, match=r"a: cannot read the log: not a text file \(byte 3 is not UTF-8\)$"):
        files.read_text(tmp_path / "a", "the log")
    assert files.read_text(tmp_path / "a", "the log", errors="replace") == "abc\ufffd"


# ---------------------------------------------------------------------------------------------- reads from anywhere


@pytest.mark.parametrize("positioned", [True, False], ids=["with preadv", "without"])
def test_a_source(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, positioned: bool) -> None:
    """A source reads any range of a file; ranges beyond its end or beyond memory raise an error."""
    if not positioned:
        monkeypatch.delattr(os, "preadv", raising=False)
    path = tmp_path / "a"
    path.write_bytes(bytes(range(100)))
    source = files.Source(path, "the data")
    assert (source.size, source.read(0, 3), source.read(97, 3)) == (100, b"\0\1\2", bytes((97, 98, 99)))
    with pytest.raises(DataError, match=f"^{path}: ends at byte 100, expected 101"):
        source.read(98, 3)
    with pytest.raises(DataError, match=f"^{path}: cannot read the data: no memory for {1 << 60} bytes"):
        source.read(0, 1 << 60)
    os.truncate(path, 50)
    with pytest.raises(DataError, match=f"^{path}: was cut to 50 of 100 bytes while in use; restore the file"):
        source.read(98, 2)


def test_a_source_that_is_gone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A file that was removed on a network drive raises a DataError, so that a training run can write a snapshot."""
    (tmp_path / "a").write_bytes(bytes(100))
    source = files.Source(tmp_path / "a", "the data")

    def stale(descriptor: int) -> files.Identity:
        raise OSError(errno.ESTALE, os.strerror(errno.ESTALE))

    monkeypatch.setattr(reading, "identity", stale)
    with pytest.raises(DataError, match=f"^{tmp_path}/a: cannot read the data: Stale file handle$"):
        source.check()


@pytest.mark.skipif(not hasattr(os, "preadv"), reason="no reads that leave a file's position alone")
def test_a_source_in_two_processes(tmp_path: Path) -> None:
    """Reads do not move the file's position, which forked processes share."""
    (tmp_path / "a").write_bytes(bytes(100))
    source = files.Source(tmp_path / "a", "the data")
    source.read(20, 30)
    assert source._stream.tell() == 0
