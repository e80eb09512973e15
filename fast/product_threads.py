"""The number of threads of OpenBLAS, which is one number for the whole process.

A product on several threads of OpenBLAS starts in less time than two jobs (parallel.py), and
no thread waits for the interpreter. The number is one otherwise, as blas.py has set it, so that
jobs on several threads have one each. It stays one if two callers want to change it at
once, if the user has set it in the environment, or if OpenBLAS has no function for it.
"""

from __future__ import annotations

import functools
import threading
from collections.abc import Callable

from netlib.files.paths import ROOT, load_module

_lock = threading.Lock()
_running = 0  # calls of ``parallel.run``, and products on several threads


@functools.cache
def _setters() -> list[Callable[[int], object]]:
    """The functions that set the number of threads; none if the user has set it."""
    blas = load_module("netlib.blas", ROOT / "fast" / "blas.py")  # as netlib has configured it
    return list(blas.thread_setters()) if blas.is_ours else []


def begin(count: int) -> bool:
    """Let a product use ``count`` threads until ``end``; False if this is not possible now."""
    global _running
    with _lock:
        if count < 2 or _running or not _setters():
            return False
        _running += 1
        _set(count)
        return True


def end() -> None:
    """After a product on several threads."""
    global _running
    with _lock:
        _running -= 1
        _set(1)


def begin_jobs() -> None:
    """Before jobs on several threads, whose products use one thread each until ``end_jobs``."""
    global _running
    with _lock:
        _running += 1
        _set(1)


def end_jobs() -> None:
    """After jobs on several threads."""
    global _running
    with _lock:
        _running -= 1


_now = 1


def _set(count: int) -> None:
    global _now
    if count != _now:
        for set_threads in _setters():
            set_threads(count)
        _now = count
