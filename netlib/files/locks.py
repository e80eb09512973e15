"""File locks that the operating system releases when a process ends."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator
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


@contextlib.contextmanager
def held(path: Path) -> Iterator[str]:
    """Context manager: hold a lock file, which is removed afterwards.

    Yields an empty text, or the number of the process that holds it instead. Raises OSError, also
    if the file is a link.
    """
    descriptor, holder = _opened(path)
    try:
        yield holder
    finally:
        if not holder:
            with contextlib.suppress(OSError):
                path.unlink()
        os.close(descriptor)


def _opened(path: Path) -> tuple[int, str]:
    """The descriptor of a lock file, and its holder if it is another process."""
    while True:
        descriptor = os.open(path, os.O_RDWR | os.O_CREAT | getattr(os, "O_NOFOLLOW", 0), 0o666)
        if not take(descriptor):
            holder = os.read(descriptor, 100).decode(errors="replace").strip()
            return descriptor, holder or "unknown"
        is_in_place = False
        with contextlib.suppress(OSError):
            is_in_place = os.path.samestat(path.lstat(), os.fstat(descriptor))
        if is_in_place:
            os.ftruncate(descriptor, 0)
            os.write(descriptor, f"{os.getpid()}\n".encode())
            return descriptor, ""
        os.close(descriptor)  # removed by its former holder after it was opened here
