"""One thread at a time per net, and locks that survive a fork.

Two threads that run one net at the same time would silently mix up their batches. In a forked process, waiting for a
thread of the parent would never end.
"""

from __future__ import annotations

import os
import threading
import weakref
from typing import Any, Protocol

from netlib.errors import NetlibError


class ForkAware(Protocol):
    """An object that owns threads or a lock."""

    def after_fork(self) -> None:
        """Discard the threads of the parent: only the forking thread exists in the child."""


_fork_aware: weakref.WeakSet[Any] = weakref.WeakSet()


def call_after_fork(what: ForkAware) -> None:
    """Call ``what.after_fork`` in every process that is forked from this one, for as long as ``what`` exists."""
    _fork_aware.add(what)


def _forked() -> None:
    for what in list(_fork_aware):
        what.after_fork()


if hasattr(os, "register_at_fork"):  # not on Windows
    os.register_at_fork(after_in_child=_forked)


def lock() -> threading.RLock:
    """Create a lock that is acquired around every fork, so that it is free in the child. It is never released from
    memory: create one per module, not per object."""
    made = threading.RLock()
    if hasattr(os, "register_at_fork"):
        os.register_at_fork(before=made.acquire, after_in_parent=made.release, after_in_child=made.release)
    return made


class OneThread:
    """Context manager for one thread at a time. That thread may enter again; any other gets a NetlibError.

    name  name of the net, for the message
    """

    def __init__(self, name: str) -> None:
        self._name = name
        self._lock = threading.RLock()
        call_after_fork(self)

    def __enter__(self) -> None:
        if not self._lock.acquire(blocking=False):
            raise NetlibError(
                f"net {self._name!r} is in use by another thread; use a separate net in each thread "
                "(share_params gives them the same weights), or serialize the calls"
            )

    def __exit__(self, *exception: object) -> None:
        self._lock.release()

    def __reduce__(self) -> tuple[type[OneThread], tuple[str]]:
        """A copy starts unlocked."""
        return OneThread, (self._name,)

    def after_fork(self) -> None:
        """Replace the lock if a thread of the parent held it."""
        if self._lock.acquire(blocking=False):
            self._lock.release()
        else:
            self._lock = threading.RLock()
