"""Atomic file replacement: write under a temporary name, sync, rename.

The temporary name ``.NAME.12345678.netlib.tmp`` is in the same folder, hidden and random. A killed
process leaves it; ``clear_leftovers`` removes it.
"""

from __future__ import annotations

import contextlib
import errno
import os
import re
import secrets
from collections.abc import Callable, Iterator
from pathlib import Path

from netlib import files
from netlib.errors import reason_of
from netlib.files.paths import names_in

# group 1 is the name of the file that is being written
TEMPORARY = re.compile(r"\.(.+)\.[0-9a-f]{8}\.netlib\.tmp")


@contextlib.contextmanager
def temporary(path: Path) -> Iterator[Path]:
    """Yield an empty file next to ``path``, to be filled and renamed; removed if it is not.

    Raises OSError.
    """
    if not path.name:  # "", "." and "/"
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR))
    # in the same folder: renaming is atomic
    fresh = path.with_name(f".{path.name}.{secrets.token_hex(4)}.netlib.tmp")
    # fails if the name exists, even as a link
    os.close(os.open(fresh, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o666))
    try:
        yield fresh
    finally:
        fresh.unlink(missing_ok=True)


def clear_leftovers(folder: Path, name: re.Pattern[str]) -> None:
    """Remove the temporary files of killed processes for files whose whole name matches; no other
    process may be writing such files.
    """
    for found in map(TEMPORARY.fullmatch, names_in(folder)):
        if found and name.fullmatch(found[1]):
            with contextlib.suppress(OSError):
                (folder / found[0]).unlink()


@contextlib.contextmanager
def replacing(path: Path, sync: bool = True) -> Iterator[Path]:
    """Context manager that yields a temporary file and replaces ``path`` by it.

    An exception leaves ``path`` as it was.

    Without ``sync`` this holds if the process is killed but not if the machine loses power. Raises
    OSError with the name ``path``.
    """
    with error_names(path), temporary(path) as fresh:
        require_regular_file(path)
        yield fresh
        commit(fresh, path, sync)


def commit(fresh: Path, path: Path, sync: bool = True) -> None:
    """Rename a temporary file to ``path``. Raises OSError."""
    if sync:
        sync_file(fresh)
    os.replace(fresh, path)
    if sync:
        sync_directory(path.parent)


def replace(path: Path, fill: Callable[[Path], object], sync: bool = True) -> None:
    """Replace ``path`` by a temporary file that ``fill`` writes.

    Raises OSError with the name ``path``.
    """
    with replacing(path, sync) as fresh:
        fill(fresh)


def replace_bytes(path: Path, content: bytes) -> None:
    """Write a file atomically and create its folder. Raises OSError with the name ``path``."""
    with error_names(path):
        path.parent.mkdir(parents=True, exist_ok=True)
    replace(path, lambda fresh: fresh.write_bytes(content))


def replace_text(path: Path, text: str) -> None:
    """Write a text file atomically. Raises OSError."""
    replace(path, lambda fresh: fresh.write_text(text, encoding="utf-8"))


def require_regular_file(path: Path) -> None:
    """Raise OSError for a folder, device or pipe, which renaming would replace."""
    if path.is_dir():
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR))
    if path.exists() and not path.is_file():
        raise OSError(errno.EINVAL, "it is a device or a pipe; expected a regular file")


def text_of(path: Path) -> str | None:
    """The text of a file, or None if it does not exist. Raises DataError."""
    return files.read_text(path, "the text") if path.exists() else None


@contextlib.contextmanager
def error_names(path: Path) -> Iterator[None]:
    """Context manager that replaces the file name in an OSError by ``path``, and raises one if no
    file can have it.
    """
    if "\0" in str(path):
        raise OSError(errno.EINVAL, "a file name cannot contain a NUL character", str(path))
    try:
        yield
    except OSError as error:
        raise OSError(error.errno, reason_of(error), str(path)) from error


def sync_file(path: Path) -> None:
    """Flush the content of a file to the disk."""
    with path.open("r+b") as file:
        os.fsync(file.fileno())


def sync_directory(directory: Path) -> None:
    """Flush the names in a folder to the disk, where supported."""
    with contextlib.suppress(OSError):  # not supported by every file system
        descriptor = os.open(directory, os.O_RDONLY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)
