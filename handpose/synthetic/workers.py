"""Processes that end when their parent does, and that leave Ctrl-C to it."""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import signal
import threading
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from multiprocessing.process import BaseProcess

from netlib.errors import DataError


@contextlib.contextmanager
def processes(workers: int) -> Iterator[ProcessPoolExecutor]:
    """A pool whose processes end with their parent. Submit within ``no_interrupt``; otherwise Ctrl-C reaches them."""
    if workers < 1:
        raise DataError(f"{workers} worker processes, expected at least one")
    pool = ProcessPoolExecutor(workers, multiprocessing.get_context("spawn"), _start_worker)
    try:
        yield pool
    finally:
        pool.shutdown(cancel_futures=True)


def _start_worker() -> None:
    """In a worker: end with the parent."""
    parent = multiprocessing.parent_process()
    assert parent is not None

    def follow(parent: BaseProcess) -> None:
        parent.join()
        os._exit(1)

    threading.Thread(target=follow, args=(parent,), daemon=True).start()


@contextlib.contextmanager
def no_interrupt() -> Iterator[None]:
    """Processes started within the block ignore Ctrl-C; their parent stops them."""
    if not hasattr(signal, "pthread_sigmask"):  # Windows
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
