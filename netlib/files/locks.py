"""Locks on files, which the end of a process releases, however it ends."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

from netlib.system.one_thread import tell

fcntl: ModuleType | None
try:
    import fcntl
except ImportError:  # not every system has these locks; there nothing is locked
    fcntl = None

NO_LINK = getattr(os, "O_NOFOLLOW", 0)


def take(descriptor: int) -> bool | None:
    """Lock an open file for whoever holds this descriptor: False if another does, None where there are no locks."""
    if fcntl is None:
        return None
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except OSError:  # not every file system has them
        return None
    return True


@contextlib.contextmanager
def held(path: Path) -> Iterator[bool | None]:
    """Within it a file or folder is locked: True if it is, False if another has it, None where there are no locks."""
    descriptor = None
    for mode in (os.O_RDWR, os.O_RDONLY) if fcntl else ():  # network file systems lock what may be written
        with contextlib.suppress(OSError):
            descriptor = os.open(path, mode | NO_LINK | getattr(os, "O_NONBLOCK", 0))
            break
    try:
        yield None if descriptor is None else take(descriptor)
    finally:
        if descriptor is not None:
            os.close(descriptor)


class Lock:
    """A file that is there and locked until ``release``, or until this process ends; ``taken`` says whether it is ours.

    A process that is forked from this one does not hold it.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.holder = ""  # who has it instead
        while True:  # one that was released between opening and locking is gone
            self._descriptor = os.open(path, os.O_RDWR | os.O_CREAT | NO_LINK, 0o666)
            locked = take(self._descriptor)
            self.taken = locked is not False
            if not locked or is_still(path, self._descriptor):
                break
            os.close(self._descriptor)
        if self.taken:
            os.ftruncate(self._descriptor, 0)
            os.write(self._descriptor, f"{os.getpid()}\n".encode())
            tell(self)
        else:
            self.holder = os.read(self._descriptor, 100).decode(errors="replace").strip()
            os.close(self._descriptor)

    def release(self) -> None:
        """Let go."""
        if self.taken:
            self.taken = False
            with contextlib.suppress(OSError):
                self.path.unlink()
            os.close(self._descriptor)

    def after_fork(self) -> None:
        """The parent goes on holding it, and its end releases it."""
        if self.taken:
            self.taken = False
            os.close(self._descriptor)


def is_still(path: Path, descriptor: int) -> bool:
    """Does this name lead to this open file?"""
    try:
        return os.path.samestat(path.lstat(), os.fstat(descriptor))
    except OSError:
        return False
