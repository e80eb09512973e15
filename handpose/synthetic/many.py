"""Many synthetic frames: the blocks of a generator one after the other, drawn by worker processes."""

from __future__ import annotations

import collections
import contextlib
import multiprocessing
import os
import signal
import threading
from collections.abc import Iterator
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from multiprocessing.process import BaseProcess
from typing import Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from handpose.synthetic.generator import BLOCK, Split
from netlib.blob import Array
from netlib.errors import DataError

_AHEAD = 16  # blocks drawn ahead of the consumer, 4 MB each


class Rows(Protocol):
    """Rows of a data set, as arrays by name."""

    @property
    def index(self) -> NDArray[np.int64]:
        """(n,) number of each row in its split."""

    def __len__(self) -> int: ...

    def arrays(self) -> dict[str, Array]:
        """All arrays, in the order of the files."""

    def rows(self: R, rows: slice) -> R:
        """Some of the rows."""


R = TypeVar("R", bound=Rows)
R_co = TypeVar("R_co", bound=Rows, covariant=True)


class Source(Protocol[R_co]):
    """Draws rows, block by block: as ``Generator`` does."""

    description: str
    seed: int
    split: Split

    def block(self, number: int) -> R_co:
        """Rows ``number * BLOCK`` and following; the result depends on the number only."""

    def columns(self) -> dict[str, Array]:
        """Arrays without rows, of the shapes and types of the rows'."""

    def made_from(self) -> dict[str, object]:
        """Everything that the rows depend on, as JSON values."""


def generate(count: int, generator: Source[R], workers: int | ProcessPoolExecutor = 1, start: int = 0) -> Iterator[R]:
    """Frames ``start`` to ``start + count`` of a generator, in pieces of at most ``BLOCK``. Raises DataError.

    ``workers`` is a number of processes, or a pool made by ``workers.processes`` for several calls. The frames and
    their order do not depend on it. Processes are spawned, so a script with more than one needs the usual ``if __name__
    == "__main__":``.
    """
    if count < 0 or start < 0:
        raise DataError(f"{count} frames from number {start}, expected 0 or more of both")
    numbers = range(start // BLOCK, -(-(start + count) // BLOCK))
    if workers == 1:
        yield from (_part(generator.block(number), start, start + count) for number in numbers)
    elif isinstance(workers, int):
        with processes(workers) as pool:
            yield from generate(count, generator, pool, start)
    else:
        for frames in _in_processes(generator, numbers, workers):
            yield _part(frames, start, start + count)


def _part(frames: R, start: int, stop: int) -> R:
    """The frames with numbers from ``start`` to ``stop``."""
    first = int(frames.index[0])
    if start <= first and first + len(frames) <= stop:
        return frames
    return frames.rows(slice(max(start - first, 0), stop - first))


def _in_processes(generator: Source[R], numbers: range, pool: ProcessPoolExecutor) -> Iterator[R]:
    """``generator.block`` of every number in order, drawn a few blocks ahead of the consumer."""
    ahead: collections.deque[Future[R]] = collections.deque()
    try:
        for number in numbers:
            with no_interrupt():
                ahead.append(pool.submit(generator.block, number))
            if len(ahead) > _AHEAD:
                yield ahead.popleft().result()
        while ahead:
            yield ahead.popleft().result()
    except BrokenProcessPool:
        raise DataError("a worker process was killed, perhaps for want of memory; try fewer workers") from None
    finally:
        for future in ahead:
            future.cancel()


# ---------------------------------------------------------------------------------------------- processes

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
