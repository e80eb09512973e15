"""File locks that the operating system releases when a process ends."""

from __future__ import annotations

import contextlib
import errno
import os
import stat
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

from netlib.system.one_thread import call_after_fork

fcntl: ModuleType | None
try:
    import fcntl
except ImportError:  # without fcntl nothing is locked
    fcntl = None

NO_LINK = getattr(os, "O_NOFOLLOW", 0)


def take(descriptor: int) -> bool | None:
    """Lock an open file. Returns False if another process holds the lock, None if locks are not supported."""
    if fcntl is None:
        return None
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except OSError:  # not supported by this file system
        return None
    return True


@contextlib.contextmanager
def held(path: Path) -> Iterator[bool | None]:
    """Lock a file or folder within the block; yields True, False if locked elsewhere, None if not supported."""
    descriptor = None
    for mode in (os.O_RDWR, os.O_RDONLY) if fcntl else ():  # network file systems lock only files open for writing
        with contextlib.suppress(OSError):
            descriptor = os.open(path, mode | NO_LINK | getattr(os, "O_NONBLOCK", 0))
            break
    try:
        yield None if descriptor is None else take(descriptor)
    finally:
        if descriptor is not None:
            _close(descriptor)


def _close(descriptor: int) -> None:
    """Close a descriptor that only held a lock: no data depend on it, so an error of the disk has no effect."""
    with contextlib.suppress(OSError):
        os.close(descriptor)


class Lock:
    """A lock file that exists until ``release`` or until this process ends; ``taken`` is True while it is held.

    A forked child process does not hold it. Raises OSError, also if a link, or anything else that is not a regular file
    with one name, is in the place of the lock file: it would be changed.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.holder = ""  # process that holds the lock instead
        while True:  # retry if the file was removed between opening and locking
            self._descriptor = os.open(path, os.O_RDWR | os.O_CREAT | NO_LINK | getattr(os, "O_NONBLOCK", 0), 0o666)
            found = os.fstat(self._descriptor)
            if not stat.S_ISREG(found.st_mode) or found.st_nlink > 1:
                _close(self._descriptor)
                raise OSError(errno.EINVAL, "it is not a regular file with one name")
            locked = take(self._descriptor)
            self.taken = locked is not False
            if not locked or is_still(path, self._descriptor):
                break
            os.close(self._descriptor)
        if self.taken:
            try:
                os.ftruncate(self._descriptor, 0)
                os.write(self._descriptor, f"{os.getpid()}\n".encode())
            except BaseException:
                self.release()
                raise
            call_after_fork(self)
        else:
            self.holder = os.read(self._descriptor, 100).decode(errors="replace").strip()
            os.close(self._descriptor)

    def release(self) -> None:
        """Remove the file and release the lock."""
        if self.taken:
            self.taken = False
            with contextlib.suppress(OSError):
                self.path.unlink()
            _close(self._descriptor)

    def after_fork(self) -> None:
        """Give up the lock in a child process; the parent keeps it."""
        if self.taken:
            self.taken = False
            os.close(self._descriptor)


def is_still(path: Path, descriptor: int) -> bool:
    """Whether ``path`` refers to this open file."""
    try:
        return os.path.samestat(path.lstat(), os.fstat(descriptor))
    except OSError:
        return False
