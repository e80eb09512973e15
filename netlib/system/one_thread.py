"""A net is used by one thread at a time, and a forked process goes on with one thread.

Nothing here is about speed: a net that two threads run at once would mix up their batches and say nothing, and what
waits in a forked process for a thread of its parent waits for ever.
"""

from __future__ import annotations

import os
import threading
import weakref
from typing import Any, Protocol

from netlib.errors import NetlibError


class Forked(Protocol):
    """What knows threads, or holds a lock."""

    def after_fork(self) -> None:
        """Forget the threads of the parent: of all threads only the one that forked goes on in the child."""


_told: weakref.WeakSet[Any] = weakref.WeakSet()


def tell(what: Forked) -> None:
    """Call its ``after_fork`` in every process that is forked from this one, as long as somebody holds it."""
    _told.add(what)


def _forked() -> None:
    for what in list(_told):
        what.after_fork()


if hasattr(os, "register_at_fork"):  # where there is fork
    os.register_at_fork(after_in_child=_forked)


def lock() -> threading.RLock:
    """One to wait for, and that no thread holds while another forks. For ever: not for what comes and goes."""
    made = threading.RLock()
    if hasattr(os, "register_at_fork"):
        os.register_at_fork(before=made.acquire, after_in_parent=made.release, after_in_child=made.release)
    return made


class OneThread:
    """``with one_thread:`` is for one thread at a time, which may enter again; another one gets a NetlibError.

    name  of the net, for the message
    """

    def __init__(self, name: str) -> None:
        self._name = name
        self._lock = threading.RLock()
        tell(self)

    def __enter__(self) -> None:
        if not self._lock.acquire(blocking=False):
            raise NetlibError(
                f"net {self._name!r} is in use by another thread; give each thread a net of its own "
                "(share_params lets them have the same weights), or let one wait for the other"
            )

    def __exit__(self, *exception: object) -> None:
        self._lock.release()

    def __reduce__(self) -> tuple[type[OneThread], tuple[str]]:
        """A copy of a net is used by nobody yet."""
        return OneThread, (self._name,)

    def after_fork(self) -> None:
        """Whoever held the lock is gone, unless it was the thread that forked."""
        if self._lock.acquire(blocking=False):
            self._lock.release()
        else:
            self._lock = threading.RLock()
