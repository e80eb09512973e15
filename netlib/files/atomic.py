"""Files that are whole or not there: written under another name, synced, renamed.

The other name is ``.NAME.12345678.netlib.tmp``, beside the file: hidden, random, made anew, so that no link is
followed. Its writer holds a lock on it. What a killed process left has no lock, and the next one that writes into the
same folder removes it.
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

OURS = re.compile(r"\..+\.[0-9a-f]{8}\.netlib\.tmp")
KEPT = re.compile(r"\.(.+)\.[0-9a-f]{8}\.netlib\.old")  # of what was being replaced; group 1 is its name


@contextlib.contextmanager
def temporary(path: Path) -> Iterator[Path]:
    """An empty file beside ``path``, to be filled and renamed within the block; else it is removed. Raises OSError."""
    with _new(path, lambda fresh: os.close(os.open(fresh, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o666))) as fresh:
        yield fresh


@contextlib.contextmanager
def temporary_folder(path: Path) -> Iterator[Path]:
    """The same with an empty folder."""
    with _new(path, os.mkdir) as fresh:
        yield fresh


@contextlib.contextmanager
def _new(path: Path, make: Callable[[Path], object]) -> Iterator[Path]:
    _clear_once(path.parent.absolute())
    while True:
        fresh = beside(path, "tmp")
        make(fresh)  # which fails where there is anything of this name, a link, too
        with locks.held(fresh) as locked:
            if locked is False or not fresh.exists():  # somebody took it for a leftover before it was locked
                continue
            try:
                yield fresh
            finally:
                _remove(fresh)
            return


def _remove(path: Path) -> None:
    """Remove a file or a folder, if it is still there."""
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path, ignore_errors=True)
    else:
        path.unlink(missing_ok=True)


def beside(path: Path, suffix: str) -> Path:
    """A new hidden name in the same folder, so that renaming is atomic. Raises OSError for what names no file."""
    if not path.name:  # "", "." and "/"
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR))
    return path.with_name(f".{path.name}.{secrets.token_hex(4)}.netlib.{suffix}")


def replace(path: Path, fill: Callable[[Path], object], sync: bool = True) -> None:
    """Have ``fill`` write a temporary file, which then takes the place of ``path``, whole or not at all.

    Without ``sync`` that is true of a run that is killed, but not of a machine that loses power. Raises OSError, with
    the file's own name.
    """
    with replacing(path, sync) as fresh:
        fill(fresh)


@contextlib.contextmanager
def replacing(path: Path, sync: bool = True) -> Iterator[Path]:
    """The same for a file that is filled within the block: an exception leaves ``path`` as it was."""
    with naming(path), temporary(path) as fresh:
        refuse_what_is_no_file(path)
        yield fresh
        take_place(fresh, path, sync)


def take_place(fresh: Path, path: Path, sync: bool = True) -> None:
    """Put a temporary file where ``path`` is. Raises OSError."""
    if sync:
        sync_file(fresh)
    os.replace(fresh, path)
    if sync:
        sync_directory(path.parent)


def replace_bytes(path: Path, content: bytes) -> None:
    """Write a file, whole or not at all, and the folder it is in. Raises OSError, with the file's own name."""
    with naming(path):
        path.parent.mkdir(parents=True, exist_ok=True)
    replace(path, lambda fresh: fresh.write_bytes(content))


def replace_text(path: Path, text: str) -> None:
    """Write a text file, whole or not at all. Raises OSError."""
    replace(path, lambda fresh: fresh.write_text(text, encoding="utf-8"))


def replace_pair(first: tuple[Path, bytes], second: tuple[Path, bytes]) -> None:
    """Write two files that belong together, both or none.

    Two files cannot be renamed at one moment. Between the two the old first one is kept under another name (``kept``),
    where whoever reads the old second one finds it. Raises OSError, with the name of one of them.
    """
    (path, content), (other, others_content) = first, second
    with contextlib.ExitStack() as stack:
        with naming(path):
            fresh = _written(path, content, stack)
        with naming(other):
            others_fresh = _written(other, others_content, stack)
        with naming(path):
            old = stack.enter_context(_second_name(path))
            os.replace(fresh, path)
        with naming(other):
            try:
                os.replace(others_fresh, other)
            except BaseException:
                os.replace(old, path) if old else path.unlink()
                raise
    for folder in {path.parent, other.parent}:
        sync_directory(folder)


def _written(path: Path, content: bytes, stack: contextlib.ExitStack) -> Path:
    """A temporary file that holds the content, on the disk."""
    refuse_what_is_no_file(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    fresh = stack.enter_context(temporary(path))
    fresh.write_bytes(content)
    sync_file(fresh)
    return fresh


def refuse_what_is_no_file(path: Path) -> None:
    """Renaming would take a device or a pipe away. Raises OSError."""
    if path.is_dir():
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR))
    if path.exists() and not path.is_file():
        raise OSError(errno.EINVAL, "it is a device or a pipe; expected the name of a file")


@contextlib.contextmanager
def _second_name(path: Path) -> Iterator[Path | None]:
    """Within it a file, if there is one, has a second name."""
    if not path.exists():
        yield None
        return
    old = beside(path, "old")
    try:
        os.link(path, old)
    except OSError:  # not every file system can
        shutil.copyfile(path, old)
    try:
        with locks.held(old):
            sync_directory(path.parent)
            yield old
    finally:
        old.unlink(missing_ok=True)


def kept(path: Path) -> list[Path]:
    """The old versions of a file, or of a folder, that who was killed while replacing it left."""
    names = [KEPT.fullmatch(name) for name in sorted(names_in(path.parent))]
    return [path.with_name(found[0]) for found in names if found and found[1] == path.name]


def discard(old: Path, path: Path) -> None:
    """Remove the old version of ``path``, which the caller has locked; no part of it is ``kept``. Raises OSError."""
    gone = beside(path, "tmp")
    old.rename(gone)
    _remove(gone)


# ------------------------------------------------------------------------------------------ what others left


def clear_leftovers(folder: Path) -> None:
    """Remove the temporary files and folders that killed processes left; those of living ones are locked."""
    for name in names_in(folder):
        if OURS.fullmatch(name):
            _clear(folder / name)


@functools.cache
def _clear_once(folder: Path) -> None:
    clear_leftovers(folder)


def _clear(path: Path) -> None:
    with locks.held(path) as locked:
        if locked:
            _remove(path)


# ------------------------------------------------------------------------------------------ small parts


def text_of(path: Path) -> str | None:
    """The text of a file, or None if there is none. Raises DataError."""
    return files.read_text(path, "the text") if path.exists() else None


@contextlib.contextmanager
def naming(path: Path) -> Iterator[None]:
    """An OSError within it is one about ``path``, whatever name it has."""
    try:
        yield
    except OSError as error:
        raise OSError(error.errno, reason_of(error), str(path)) from error


def sync_file(path: Path) -> None:
    """Have the content of a file reach the disk."""
    with path.open("r+b") as file:
        os.fsync(file.fileno())


def sync_directory(directory: Path) -> None:
    """Have the names of files reach the disk, where that can be done."""
    with contextlib.suppress(OSError):  # not every file system can
        descriptor = os.open(directory, os.O_RDONLY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)
