"""Files that are whole or not there: written under another name, synced, renamed."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Callable
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
