"""File locks that the operating system releases when a process ends."""

from __future__ import annotations

import contextlib
import os
from pathlib import Path
from types import ModuleType

fcntl: ModuleType | None
try:
    import fcntl
except ImportError:  # without fcntl nothing is locked
    fcntl = None


def take(descriptor: int) -> bool:
    """Lock an open file.

    Returns False if another process holds the lock; True also where locks are not supported.
    """
    if fcntl is not None:
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            return False
        except OSError:  # not supported by this file system
            pass
    return True


class Lock:
    """A lock file that exists until ``release`` or until this process ends; ``taken`` is True
    while it is held.

    ``holder`` is the number of the process that holds it instead. Raises OSError, also if the
    file is a link.
    """

    def __init__(self, path: Path) -> None:
        self.path, self.holder = path, ""
        while True:
            self._descriptor = os.open(
                path, os.O_RDWR | os.O_CREAT | getattr(os, "O_NOFOLLOW", 0), 0o666
            )
            self.taken = take(self._descriptor)
            if not self.taken or self._is_in_place():
                break
            os.close(self._descriptor)  # removed by its former holder after it was opened here
        if self.taken:
            os.ftruncate(self._descriptor, 0)
            os.write(self._descriptor, f"{os.getpid()}\n".encode())
        else:
            self.holder = os.read(self._descriptor, 100).decode(errors="replace").strip()
            os.close(self._descriptor)

    def _is_in_place(self) -> bool:
        """Whether the path still refers to the open file."""
        try:
            return os.path.samestat(self.path.lstat(), os.fstat(self._descriptor))
        except OSError:
            return False

    def release(self) -> None:
        """Remove the file and release the lock."""
        if self.taken:
            self.taken = False
            with contextlib.suppress(OSError):
                self.path.unlink()
            os.close(self._descriptor)
