"""Files that are whole or not there, and runs that end between two of them."""

from __future__ import annotations

import os
import shutil
import signal
import threading
from collections.abc import Callable
from pathlib import Path
from types import FrameType
from typing import Any

from netlib.errors import DataError, reason_of


def text_of(path: Path) -> str | None:
    """The text of a file, or None if there is none. Raises DataError."""
    try:
        return path.read_text(encoding="utf-8")
    except FileNotFoundError:
        return None
    except (OSError, UnicodeDecodeError) as error:
        raise DataError(f"{path}: {reason_of(error)}") from None


def check_room(out: Path, need: int) -> None:
    """Raise DataError if a folder's disk has fewer than ``need`` bytes left."""
    free = shutil.disk_usage(out).free
    if need > free:
        raise DataError(f"{out}: needs {need / 1e6:.0f} MB, {free / 1e6:.0f} MB are free")


def replace(path: Path, fill: Callable[[Path], object], sync: bool = True) -> None:
    """Have ``fill`` write a temporary file, which then takes the place of ``path``, whole or not at all.

    Without ``sync`` that is true of a run that is killed, but not of a machine that loses power.
    """
    temporary = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    try:
        fill(temporary)
        if sync:
            with temporary.open("r+b") as file:
                os.fsync(file.fileno())
        temporary.replace(path)
        if sync and os.name == "posix":  # the new name, too, must reach the disk
            folder = os.open(path.parent, os.O_RDONLY)
            try:
                os.fsync(folder)
            finally:
                os.close(folder)
    finally:
        temporary.unlink(missing_ok=True)


def replace_text(path: Path, text: str) -> None:
    """Write a text file, whole or not at all."""
    replace(path, lambda temporary: temporary.write_text(text, encoding="utf-8"))


class StoppedError(Exception):
    """A signal asked the run to end."""


class Stopper:
    """Within it, the first Ctrl-C or SIGTERM is only noted, to be raised by ``check``; a second one hits at once.

    An exception that the signal itself raised could fall into a place that swallows it.
    """

    signum = 0
    _before: dict[signal.Signals, Any]

    def __enter__(self) -> Stopper:
        self._before = {}
        if threading.current_thread() is threading.main_thread():
            self._before = {number: signal.signal(number, self._note) for number in (signal.SIGINT, signal.SIGTERM)}
        return self

    def __exit__(self, *exception: object) -> None:
        for number, handler in self._before.items():
            signal.signal(number, handler)

    def _note(self, signum: int, frame: FrameType | None) -> None:
        self.signum = signum
        self.__exit__()

    def check(self) -> None:
        """Raise StoppedError if a signal came."""
        if self.signum:
            raise StoppedError
