"""One pool of threads for the whole process, and one knob: ``set_threads``.

NumPy lets go of the interpreter inside its loops and products, so plain Python threads run truly side by
side there. ``run`` is the only way in; called from one of its own jobs it simply does the work itself.
"""

from __future__ import annotations

import os
import threading
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

from netlib.engine import available_cpus

_here = threading.local()
_threads = 0  # 0: not decided yet
_pool: ThreadPoolExecutor | None = None


def threads() -> int:
    """Number of threads in use: ``set_threads``, else NETLIB_NUM_THREADS, else one per processor."""
    if not _threads:
        set_threads(_threads_from_environment())
    return _threads


def _threads_from_environment() -> int:
    text = os.environ.get("NETLIB_NUM_THREADS", "")
    return int(text) if text.isdecimal() and int(text) > 0 else available_cpus()


def set_threads(count: int) -> None:
    """Use ``count`` threads from now on. Results do not depend on it, not in one bit."""
    global _threads, _pool
    if count < 1:
        raise ValueError(f"the number of threads must be at least 1, not {count}")
    if count != _threads:
        if _pool is not None:
            _pool.shutdown(wait=True)
        _pool = ThreadPoolExecutor(count - 1, "netlib") if count > 1 else None
        _threads = count


def run(jobs: Sequence[Callable[[], None]]) -> None:
    """Do all jobs, in any order, and return when the last is done. The first exception is raised."""
    helpers = min(threads(), len(jobs)) - 1
    if helpers < 1 or _pool is None or getattr(_here, "inside", False):
        for job in jobs:
            job()
        return
    queue = iter(jobs)  # next() on a list iterator is atomic: each job is taken once
    failed: list[BaseException] = []

    def work() -> None:
        _here.inside = True
        try:
            for job in queue:
                if failed:
                    return
                job()
        except BaseException as error:
            failed.append(error)
        finally:
            _here.inside = False

    others = [_pool.submit(work) for _ in range(helpers)]
    work()
    for other in others:
        other.result()
    if failed:
        raise failed[0]


def buffer_of(buffers: threading.local, key: str, shape: tuple[int, ...], dtype: DTypeLike) -> NDArray[Any]:
    """Memory of the calling thread under a name: zeros at first and in a new shape, else what was left in it."""
    kept: dict[str, NDArray[Any]] = buffers.__dict__
    found = kept.get(key)
    if found is None or found.shape != shape:
        found = kept[key] = np.zeros(shape, dtype)
    return found


def blocks(count: int, size: int) -> list[slice]:
    """``range(count)`` cut into slices of ``size``, the last one shorter."""
    return [slice(start, min(start + size, count)) for start in range(0, count, size)]
