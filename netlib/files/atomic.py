"""Atomic file replacement: write under a temporary name, sync, rename.

The temporary name ``.NAME.12345678.netlib.tmp`` is in the same folder, hidden and random, and the file is created
exclusively, so that no link is followed. Its writer holds a lock on it. A file left by a killed process is not locked,
and the next process that writes into the folder removes it.
"""

from __future__ import annotations

import contextlib
import errno
import functools
import os
import re
import secrets
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path

from netlib import files
from netlib.errors import reason_of
from netlib.files import locks
from netlib.files.paths import names_in

TEMPORARY = re.compile(r"\..+\.[0-9a-f]{8}\.netlib\.tmp")
BACKUP = re.compile(r"\.(.+)\.[0-9a-f]{8}\.netlib\.old")  # backup name of a replaced file; group 1 is its name


@contextlib.contextmanager
def temporary(path: Path) -> Iterator[Path]:
    """Yield an empty file next to ``path``, to be filled and renamed; removed if it is not. Raises OSError."""
    with _new(path, _create) as fresh:
        yield fresh


@contextlib.contextmanager
def temporary_folder(path: Path) -> Iterator[Path]:
    """Yield an empty folder next to ``path``, to be filled and renamed; removed if it is not. Raises OSError."""
    with _new(path, os.mkdir) as fresh:
        yield fresh


def _create(path: Path) -> None:
    """Create an empty file exclusively; removed again if closing it fails, as network file systems do."""
    descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o666)
    try:
        os.close(descriptor)
    except BaseException:
        _remove(path)
        raise


@contextlib.contextmanager
def _new(path: Path, make: Callable[[Path], object]) -> Iterator[Path]:
    _clear_once(path.parent.absolute())
    while True:
        fresh = sibling(path, "tmp")
        make(fresh)  # fails if the name exists, even as a link
        with locks.held(fresh) as locked:
            if locked is False or not fresh.exists():  # removed as a leftover before it was locked
                continue
            try:
                yield fresh
            finally:
                _remove(fresh)
            return


def _remove(path: Path) -> None:
    """Remove a file or a folder if it exists."""
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path, ignore_errors=True)
    else:
        path.unlink(missing_ok=True)


def sibling(path: Path, suffix: str) -> Path:
    """A new hidden name in the same folder, so that renaming is atomic. Raises OSError if ``path`` has no name."""
    if not path.name:  # "", "." and "/"
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR))
    return path.with_name(f".{path.name}.{secrets.token_hex(4)}.netlib.{suffix}")


def replace(path: Path, fill: Callable[[Path], object], sync: bool = True) -> None:
    """Replace ``path`` atomically by a temporary file that ``fill`` writes.

    Without ``sync`` this holds if the process is killed but not if the machine loses power. Raises OSError with the
    name ``path``.
    """
    with replacing(path, sync) as fresh:
        fill(fresh)


@contextlib.contextmanager
def replacing(path: Path, sync: bool = True) -> Iterator[Path]:
    """Context manager that yields a temporary file and replaces ``path`` by it. An exception leaves ``path`` as it was.

    Raises OSError with the name ``path``.
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


def replace_bytes(path: Path, content: bytes) -> None:
    """Write a file atomically and create its folder. Raises OSError with the name ``path``."""
    with error_names(path):
        path.parent.mkdir(parents=True, exist_ok=True)
    replace(path, lambda fresh: fresh.write_bytes(content))


def replace_text(path: Path, text: str) -> None:
    """Write a text file atomically. Raises OSError."""
    replace(path, lambda fresh: fresh.write_text(text, encoding="utf-8"))


def replace_pair(first: tuple[Path, bytes], second: tuple[Path, bytes]) -> None:
    """Write two files that belong together: both, or none.

    Two files cannot be renamed in one step. In between, the old first file has another name (``backups``), under which
    a reader of the old second file finds it. Raises OSError with the name of one of them.
    """
    (path, content), (other, others_content) = first, second
    with contextlib.ExitStack() as stack:
        with error_names(path):
            fresh = _written(path, content, stack)
        with error_names(other):
            others_fresh = _written(other, others_content, stack)
        with error_names(path):
            old = stack.enter_context(_backup(path))
            os.replace(fresh, path)
        with error_names(other):
            try:
                os.replace(others_fresh, other)
            except BaseException:
                os.replace(old, path) if old else path.unlink()
                raise
    for folder in {path.parent, other.parent}:
        sync_directory(folder)


def _written(path: Path, content: bytes, stack: contextlib.ExitStack) -> Path:
    """Write the content to a temporary file and flush it to the disk."""
    require_regular_file(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    fresh = stack.enter_context(temporary(path))
    fresh.write_bytes(content)
    sync_file(fresh)
    return fresh


def require_regular_file(path: Path) -> None:
    """Raise OSError for a folder, device or pipe, which renaming would replace."""
    if path.is_dir():
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR))
    if path.exists() and not path.is_file():
        raise OSError(errno.EINVAL, "it is a device or a pipe; expected a regular file")


@contextlib.contextmanager
def _backup(path: Path) -> Iterator[Path | None]:
    """Context manager: an existing file has a second name within it."""
    if not path.exists():
        yield None
        return
    old = sibling(path, "old")
    try:
        os.link(path, old)
    except OSError:  # file systems without hard links
        shutil.copyfile(path, old)
    try:
        with locks.held(old):
            sync_directory(path.parent)
            yield old
    finally:
        old.unlink(missing_ok=True)


def backups(path: Path) -> list[Path]:
    """Old versions of a file or folder, left by processes that were killed while replacing it."""
    names = [BACKUP.fullmatch(name) for name in sorted(names_in(path.parent))]
    return [path.with_name(found[0]) for found in names if found and found[1] == path.name]


def discard(old: Path, path: Path) -> None:
    """Remove the old version of ``path``, locked by the caller; never leaves a partial backup. Raises OSError."""
    gone = sibling(path, "tmp")
    old.rename(gone)
    _remove(gone)


# ------------------------------------------------------------------------------------------ leftovers


def clear_leftovers(folder: Path) -> None:
    """Remove temporary files and folders of killed processes; those of running processes are locked."""
    for name in names_in(folder):
        if TEMPORARY.fullmatch(name):
            _clear(folder / name)


@functools.cache
def _clear_once(folder: Path) -> None:
    clear_leftovers(folder)


def _clear(path: Path) -> None:
    with locks.held(path) as locked:
        if locked:
            _remove(path)


# ------------------------------------------------------------------------------------------ helpers


def text_of(path: Path) -> str | None:
    """The text of a file, or None if it does not exist. Raises DataError."""
    return files.read_text(path, "the text") if path.exists() else None


@contextlib.contextmanager
def error_names(path: Path) -> Iterator[None]:
    """Context manager that replaces the file name in an OSError by ``path``."""
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
