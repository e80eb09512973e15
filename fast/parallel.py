"""The pool of threads of the process, whose size ``set_threads`` sets, and working memory.

NumPy releases the interpreter lock inside its loops and products, so Python threads run in
parallel there. ``run`` executes jobs; a nested call from one of several jobs executes them in
the same thread.

Threads do not survive a fork, so a forked process starts new ones at its first job (``Workers``).
"""

from __future__ import annotations

import math
import os
import threading
from collections.abc import Callable, Sequence
from functools import partial
from queue import SimpleQueue
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

from netlib.blob import blocks, divide_up
from netlib.engine import available_cpus
from netlib.system import memory


def equal_blocks(count: int, number: int) -> list[slice]:
    """Split ``range(count)`` into at most ``number`` slices of equal size, the last one shorter."""
    return blocks(count, divide_up(count, max(number, 1)) or 1)


class Workers:
    """Threads that wait for jobs. They are started at the first job, in a forked process anew."""

    def __init__(self) -> None:
        self._process, self._started = os.getpid(), 0
        self._jobs: SimpleQueue[Callable[[], None]] = SimpleQueue()

    def submit(self, job: Callable[[], None], count: int) -> None:
        """Call ``job`` on one of at least ``count`` threads."""
        if self._process != os.getpid():
            Workers.__init__(self)
        while self._started < count:
            self._started += 1
            # a daemon, because an idle thread must not keep the process running
            threading.Thread(target=_serve, args=(self._jobs,), name="netlib", daemon=True).start()
        self._jobs.put(job)


def _serve(jobs: SimpleQueue[Callable[[], None]]) -> None:
    while True:
        job = jobs.get()
        job()
        del job  # a waiting thread must not keep arrays


_here = threading.local()
_workers = Workers()
_threads: int | None = None  # in use; None: not decided yet


def threads() -> int:
    """Number of threads in use: ``set_threads``, else NETLIB_NUM_THREADS, else one
    per processor.
    """
    if _threads is None:
        text = os.environ.get("NETLIB_NUM_THREADS", "")
        set_threads(int(text) if text.isdecimal() and int(text) > 0 else available_cpus())
    assert _threads is not None
    return _threads


def set_threads(count: int) -> None:
    """Use ``count`` threads from now on.

    Results depend on it at most by rounding, where a product is divided.
    """
    global _threads
    if count < 1:
        raise ValueError(f"the number of threads must be at least 1, not {count}")
    _threads = count


def is_inside() -> bool:
    """Whether the caller is one of several jobs of ``run``, for any number of threads."""
    return bool(getattr(_here, "inside", False))


def run(jobs: Sequence[Callable[[], None]], *, here: bool = False) -> None:
    """Run all jobs, in any order, and return when all are done.

    Raises the first exception of a job.

    here  in the calling thread, which is faster for jobs of little work
    """
    if here or len(jobs) < 2 or is_inside():
        for job in jobs:
            job()
        return
    queue = iter(jobs)  # next() on a list iterator is atomic: each job is taken once
    failed: list[BaseException] = []

    def work() -> None:
        _here.inside = True
        try:
            with np.errstate(all="ignore"):  # set per thread; as in netlib/net.py
                for job in queue:
                    if failed:
                        return
                    job()
        except BaseException as error:
            failed.append(error)
        finally:
            _here.inside = False

    _work_together(min(threads(), len(jobs)) - 1, work, failed)
    if failed:
        raise failed[0]


def _work_together(helpers: int, work: Callable[[], None], failed: list[BaseException]) -> None:
    """Call ``work`` here and on other threads, and return when all calls have returned.

    A thread that has not begun when ``work`` has returned here is not needed any more.
    """
    places = [threading.RLock() for _ in range(helpers)]

    def help_(place: threading.RLock) -> None:
        if place.acquire(blocking=False):
            work()
            place.release()

    try:
        for place in places:
            _workers.submit(partial(help_, place), helpers)
        work()
    except BaseException as error:  # an interrupt: what jobs write must not change any more
        failed.insert(0, error)
    while places:  # a thread that has begun ends, and another one can no longer begin
        try:
            places[-1].acquire()
            places.pop()
        except BaseException as error:
            failed.insert(0, error)


# ------------------------------------------------------------------------------------------- memory

# Bytes of a cache line and of an AVX-512 register, at multiples of which arrays start. NumPy's
# start at multiples of 16 bytes, where each load and store of a large register touches two lines:
# operations on arrays in the cache take up to twice as long.
LINE = 64


def aligned(
    shape: tuple[int, ...], dtype: DTypeLike, make: Callable[[int, DTypeLike], Any] = np.empty
) -> NDArray[Any]:
    """An array that starts at a multiple of LINE bytes, of the values of ``make``,
    such as np.zeros.
    """
    size = math.prod(shape) * np.dtype(dtype).itemsize
    values = make(size + LINE, np.uint8)
    start = -int(values.ctypes.data) % LINE
    found: NDArray[Any] = values[start : start + size].view(dtype).reshape(shape)
    return found


def zeros_for_blob(shape: tuple[int, ...], dtype: DTypeLike) -> NDArray[Any]:
    """An array of zeros for a blob. Raises OutOfMemoryError."""
    memory.check(math.prod(shape) * np.dtype(dtype).itemsize, f"for an array {shape}")
    return aligned(shape, dtype, np.zeros)


_scratch = threading.local()
# of working memory that are kept, because making them takes longer than a small operation
MAX_VIEWS = 1000


def scratch(key: str, shape: tuple[int, ...], dtype: DTypeLike) -> NDArray[Any]:
    """Working memory of the calling thread for all layers: any values, valid until the next
    call with ``key``.
    """
    kept: dict[str, tuple[NDArray[np.uint8], dict[Any, NDArray[Any]]]] = _scratch.__dict__
    values, views = kept.get(key) or (None, {})
    if (found := views.get((shape, dtype))) is not None:
        return found
    size = math.prod(shape) * np.dtype(dtype).itemsize
    if values is None or values.size < size or len(views) == MAX_VIEWS:
        del values, views
        kept.pop(key, None)  # release the old memory before the new one is allocated
        values, views = kept[key] = aligned((size,), np.uint8), {}
    views[shape, dtype] = found = values[:size].view(dtype).reshape(shape)
    return found


def buffer_of(
    buffers: threading.local, key: str, shape: tuple[int, ...], dtype: DTypeLike
) -> NDArray[Any]:
    """Memory of the calling thread by name: zeros at first and in a new shape, else the values
    of its last use.
    """
    kept: dict[str, NDArray[Any]] = buffers.__dict__
    found = kept.get(key)
    if found is None or found.shape != shape:
        found = kept[key] = aligned(shape, dtype, np.zeros)
    return found
