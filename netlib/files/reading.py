"""Reading files named by the user: regular files up to a size limit, with one-line errors.

Reading from a pipe could block forever, a device may never end, and a file may be
larger than memory.
"""

from __future__ import annotations

import contextlib
import os
import stat
import threading
import weakref
from collections.abc import Iterator
from io import BufferedReader, FileIO
from pathlib import Path
from typing import NamedTuple

from netlib.errors import DataError, NetlibError, reason_of

# limit of a file that is read at once; the limit of a protocol buffers message
MAX_BYTES = (1 << 31) - 1
MAX_TEXT_BYTES = 1 << 28

KINDS = {
    stat.S_IFIFO: "it is a pipe",
    stat.S_IFCHR: "it is a device",
    stat.S_IFBLK: "it is a device",
    stat.S_IFSOCK: "it is a socket",
    stat.S_IFDIR: "Is a directory",
}


# Lists of ``noted``, a value of the process: the files that a net reads are opened below layers,
# which have no argument for it.
_notebooks: list[list[str | Path]] = []


@contextlib.contextmanager
def noted() -> Iterator[list[str | Path]]:
    """Yield a list to which the name of each file read within the block is appended."""
    names: list[str | Path] = []
    _notebooks.append(names)
    try:
        yield names
    finally:
        _notebooks[:] = [other for other in _notebooks if other is not names]


@contextlib.contextmanager
def refused(
    path: str | Path, what: str, kind: type[NetlibError] = DataError, verb: str = "read"
) -> Iterator[None]:
    """Context manager: raise ``kind`` for a file, ``what`` in the message, that cannot be read, or
    with another ``verb`` written.
    """
    try:
        yield
    except (OSError, ValueError, MemoryError) as error:  # ValueError: a name that no file can have
        raise kind(f"{path}: cannot {verb} {what}: {reason_of(error)}") from error


def opened(path: str | Path, what: str, kind: type[NetlibError] = DataError) -> FileIO:
    """Open a file for reading; ``what`` describes it in errors. Raises ``kind``."""
    with refused(path, what, kind):
        _check(Path(path).stat(), path, what, kind)
        stream = FileIO(path, "rb")
    for names in _notebooks:
        names.append(path)
    return stream


def read_bytes(
    path: str | Path,
    what: str,
    kind: type[NetlibError] = DataError,
    limit: float = MAX_BYTES,
    first: int | None = None,
) -> bytes:
    """Content of a file, or its ``first`` bytes.

    Raises ``kind``, also if it is larger than ``limit``.
    """
    with opened(path, what, kind) as raw, BufferedReader(raw) as stream, refused(path, what, kind):
        # files in /proc have size 0 and may be endless
        size = os.fstat(stream.fileno()).st_size
        if first is None and size > limit:
            raise kind(
                f"{path}: {size} bytes, which is too large for {what}; at most {int(limit)} are read"
            )
        return stream.read(size if first is None else min(size, first))


def read_text(
    path: str | Path,
    what: str,
    kind: type[NetlibError] = DataError,
    errors: str = "strict",
    limit: int = MAX_TEXT_BYTES,
) -> str:
    """Text of a UTF-8 file without byte order mark, with line breaks converted to ``\\n``.

    Raises ``kind``.
    """
    content = read_bytes(path, what, kind, limit)
    try:
        text = content.decode("utf-8-sig", errors)
    except UnicodeDecodeError as error:
        where = f"byte {error.start} is not UTF-8"
        raise kind(f"{path}: cannot read {what}: {reason_of(error)} ({where})") from error
    return text.replace("\r\n", "\n").replace("\r", "\n") if "\r" in text else text


def _identity(descriptor: int) -> tuple[int, ...]:
    """Values that identify the content of an open file and change if it is modified."""
    status = os.fstat(descriptor)
    return status.st_dev, status.st_ino, status.st_size, status.st_mtime_ns


class Content(NamedTuple):
    """The content of a file that is read once and used several times."""

    path: Path
    data: bytes

    def __str__(self) -> str:
        """The path, for messages."""
        return str(self.path)


class Source:
    """A file open for random-access reads by threads and forked processes. Raises DataError.

    path   path of the file; ``what`` describes it in errors
    place  device and inode
    size   size in bytes when it was opened
    """

    def __init__(self, path: Path, what: str) -> None:
        self.path = path
        self._what = what
        self._stream = opened(path, what)
        self._identity = _identity(self._stream.fileno())
        self.place = self._identity[:2]
        self.size = self._identity[2]
        self._lock = threading.Lock()
        _sources.add(self)
        weakref.finalize(self, self._stream.close)

    def check(self) -> None:
        """Raise DataError if the file was changed."""
        with refused(self.path, self._what):  # removed on a network file system
            now = _identity(self._stream.fileno())
        if now != self._identity:
            was = f"cut to {now[2]} of {self.size} bytes" if now[2] < self.size else "changed"
            raise DataError(f"{self.path}: was {was} while in use; restore the file and run again")

    def read(self, offset: int, count: int) -> bytes:
        """Read ``count`` bytes from ``offset`` on. Raises DataError."""
        try:
            target = bytearray(count)
            self.read_into(memoryview(target), offset)
            return bytes(target)
        except MemoryError:
            raise DataError(
                f"{self.path}: cannot read {self._what}: no memory for {count} bytes"
            ) from None

    def read_into(self, target: memoryview, offset: int) -> None:
        """Fill ``target`` with the bytes from ``offset`` on. Raises DataError."""
        done = 0
        with refused(self.path, self._what):
            while done < len(target) and (count := self._read_some(target[done:], offset + done)):
                done += count
        if done < len(target):
            self.check()
            raise DataError(
                f"{self.path}: ends at byte {offset + done}, expected {offset + len(target)}"
            )

    def _read_some(self, target: memoryview, offset: int) -> int:
        if hasattr(os, "preadv"):  # does not move the file position, which forked processes share
            return os.preadv(self._stream.fileno(), [target], offset)
        with self._lock:
            self._stream.seek(offset)
            return self._stream.readinto(target) or 0


def make_folder(path: Path) -> None:
    """Create a folder and its parents if missing. Raises NetlibError, OSError."""
    try:
        path.mkdir(parents=True, exist_ok=True)
    except (FileExistsError, NotADirectoryError):
        for place in (path, *path.parents):
            if place.exists() and not place.is_dir():
                found = KINDS.get(stat.S_IFMT(place.stat().st_mode), "is a file").removeprefix(
                    "it "
                )
                raise NetlibError(f"{place}: {found}; expected a folder") from None
        raise
    except ValueError as error:  # a name that no file can have
        raise NetlibError(f"{path}: cannot make the folder: {reason_of(error)}") from error


_sources: weakref.WeakSet[Source] = weakref.WeakSet()


def is_in_use(path: Path) -> bool:
    """Whether this file, under any name, is open as a Source."""
    try:
        status = path.stat()
    except (OSError, ValueError):
        return False
    return any(source.place == (status.st_dev, status.st_ino) for source in list(_sources))


def _check(status: os.stat_result, path: str | Path, what: str, kind: type[NetlibError]) -> None:
    found = stat.S_IFMT(status.st_mode)
    if found != stat.S_IFREG:
        raise kind(
            f"{path}: cannot read {what}: {KINDS.get(found, 'it is not a regular file')}; expected a file"
        )


@contextlib.contextmanager
def located(where: object) -> Iterator[None]:
    """Context manager: the text of a DataError in the block begins with the place ``where``."""
    try:
        yield
    except DataError as error:
        raise DataError(f"{where}: {error}") from None
