"""Files that are whole or not there: written under another name, synced, renamed."""

from __future__ import annotations

import contextlib
import errno
import os
from collections.abc import Callable, Sequence
from pathlib import Path

from netlib.errors import DataError, reason_of


def replace(path: Path, fill: Callable[[Path], object], sync: bool = True) -> None:
    """Have ``fill`` write a temporary file, which then takes the place of ``path``, whole or not at all.

    Without ``sync`` that is true of a run that is killed, but not of a machine that loses power.
    """
    temporary = beside(path, "tmp")
    try:
        fill(temporary)
        if sync:
            with temporary.open("r+b") as file:
                os.fsync(file.fileno())
        temporary.replace(path)
        if sync:
            sync_directory(path.parent)
    finally:
        temporary.unlink(missing_ok=True)


def replace_all(files: Sequence[tuple[Path, bytes]]) -> None:
    """Write all files beside their targets, then rename them in order; if that fails, the old files are back.

    An old last file is put aside before the others change: it never stands beside files that are not its own. Raises
    OSError, with the target's name.
    """
    current = files[0][0]
    fresh = {path: beside(path, "tmp") for path, _ in files}
    aside: dict[Path, Path] = {}
    try:
        for path, content in files:
            current = path
            if path.is_dir():  # which could be put aside like an old file
                raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR))
            path.parent.mkdir(parents=True, exist_ok=True)
            with open(fresh[path], "wb") as out:
                out.write(content)
                out.flush()
                os.fsync(out.fileno())
        for path, _ in reversed(files):
            current = path
            if path.exists():
                old = beside(path, "old")
                os.replace(path, old)
                aside[path] = old
        for path, _ in files:
            current = path
            os.replace(fresh[path], path)
            sync_directory(path.parent)
    except BaseException as error:
        for path, old in aside.items():
            os.replace(old, path)
        if isinstance(error, OSError):
            raise OSError(error.errno, reason_of(error), str(current)) from error
        raise
    finally:
        for leftover in [*fresh.values(), *aside.values()]:
            with contextlib.suppress(OSError):
                leftover.unlink(missing_ok=True)


def replace_text(path: Path, text: str) -> None:
    """Write a text file, whole or not at all."""
    replace(path, lambda temporary: temporary.write_text(text, encoding="utf-8"))


def text_of(path: Path) -> str | None:
    """The text of a file, or None if there is none. Raises DataError."""
    try:
        return path.read_text(encoding="utf-8")
    except FileNotFoundError:
        return None
    except (OSError, UnicodeDecodeError) as error:
        raise DataError(f"{path}: {reason_of(error)}") from None


def beside(path: Path, suffix: str) -> Path:
    """A hidden name in the same directory, so that renaming is atomic."""
    return path.with_name(f".{path.name}.{os.getpid()}.{suffix}")


def sync_directory(directory: Path) -> None:
    """Have the names of files reach the disk, where that can be done."""
    with contextlib.suppress(OSError):  # not every file system can
        descriptor = os.open(directory, os.O_RDONLY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)
