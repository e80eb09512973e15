"""Many synthetic frames: the blocks of a generator one after the other, drawn by worker processes."""

from __future__ import annotations

import collections
from collections.abc import Iterator
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool

from handpose.data.frames import Frames
from handpose.synthetic.generator import BLOCK, Generator
from handpose.synthetic.workers import no_interrupt, processes
from netlib.errors import DataError

_AHEAD = 16  # blocks drawn ahead of the consumer, 4 MB each


def generate(
    count: int, generator: Generator, workers: int | ProcessPoolExecutor = 1, start: int = 0
) -> Iterator[Frames]:
    """Frames ``start`` to ``start + count`` of a generator, in pieces of at most ``BLOCK``. Raises DataError.

    ``workers`` is a number of processes, or a pool made by ``workers.processes`` for several calls. The frames and
    their order do not depend on it. Processes are spawned, so a script that asks for more than one needs the usual
    ``if __name__ == "__main__":``.
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


def _part(frames: Frames, start: int, stop: int) -> Frames:
    """Those of the frames whose number is from ``start`` to ``stop``."""
    first = int(frames.index[0])
    if start <= first and first + len(frames) <= stop:
        return frames
    return frames.rows(slice(max(start - first, 0), stop - first))


def _in_processes(generator: Generator, numbers: range, pool: ProcessPoolExecutor) -> Iterator[Frames]:
    """``generator.block`` of every number in order, drawn a few blocks ahead of the consumer."""
    ahead: collections.deque[Future[Frames]] = collections.deque()
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
