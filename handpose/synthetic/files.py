"""Synthetic rows in any number: drawn block by block by worker processes, and as a
data set on disk.

A data set consists of parts of some thousand rows, and a list of them for each split. Existing
parts of the same data are kept, so an interrupted run continues where it stopped, and a second
run does nothing.
"""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from multiprocessing.process import BaseProcess
from pathlib import Path

from handpose.datasets import parts
from handpose.datasets.frames import Frames
from handpose.datasets.parts import Columns, Part
from handpose.synthetic.generator import BLOCK, Generator
from netlib.blob import divide_up
from netlib.errors import DataError
from netlib.files import atomic


def generate(
    count: int, generator: Generator, pool: ProcessPoolExecutor | None = None, start: int = 0
) -> Iterator[Frames]:
    """Frames ``start`` to ``start + count`` of a generator, in pieces of at most ``BLOCK``.

    Raises DataError.

    ``pool`` is made by ``processes``; the frames and their order do not depend on it. Processes are
    spawned, so a script with a pool needs the usual ``if __name__ == "__main__":``.
    """
    numbers = range(start // BLOCK, divide_up(start + count, BLOCK))
    with no_interrupt():
        blocks = (
            map(generator.block, numbers) if pool is None else pool.map(generator.block, numbers)
        )
    try:
        for frames in blocks:
            first = int(frames.index[0])
            yield frames.rows(slice(max(start - first, 0), start + count - first))
    except BrokenProcessPool:
        raise DataError(
            "a worker process was killed, perhaps for want of memory; try fewer workers"
        ) from None


# ---------------------------------------------------------------------------------------- processes


@contextlib.contextmanager
def processes(workers: int) -> Iterator[ProcessPoolExecutor | None]:
    """A pool whose processes end with their parent; none for one worker.

    Submit within ``no_interrupt``; otherwise Ctrl-C reaches them.
    """
    if workers == 1:
        yield None
        return
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


# -------------------------------------------------------------------------------------------- files

MADE_FROM = "synthetic"


class DataSet:
    """Synthetic rows of some splits as files in a folder.

    out      the folder
    sources  a generator and the number of its rows for each split
    force    write everything again, and replace data of another origin

    Raises DataError where data of another origin or kind would be replaced, and if
    the disk is full.
    """

    def __init__(
        self, out: Path, sources: Sequence[tuple[Generator, int]], force: bool = False
    ) -> None:
        parts.check_space(out, [(count, made.block(0).arrays()) for made, count in sources])
        self.lists: dict[Path, str] = {}
        every: dict[Part, Generator] = {}
        for generator, count in sources:
            own = parts.parts_of(out, generator.split, count, MADE_FROM, generator.made_from)
            every |= dict.fromkeys(own, generator)
            self.lists[out / f"{generator.split}.txt"] = parts.list_text(part.path for part in own)
        self.missing = {
            part: every[part] for part in parts.missing_of(list(every), list(self.lists), force)
        }

    @property
    def is_whole(self) -> bool:
        """True if nothing is left to be written."""
        return not self.missing and all(
            atomic.text_of(path) == text for path, text in self.lists.items()
        )

    @property
    def missing_frames(self) -> int:
        """The number of frames to be written."""
        return sum(part.rows for part in self.missing)

    def write(self, workers: int, advance: Callable[[int], None]) -> None:
        """Write the missing parts, then the lists. Raises DataError, OSError.

        workers  number of processes
        advance  called with the number of further frames; its exceptions end the run and keep
                 complete files only.
        """
        if self.missing:
            for path in self.lists:
                path.unlink(missing_ok=True)  # no list may name files of two kinds
            with processes(workers) as pool:
                for part, generator in self.missing.items():
                    _write(part, generator, pool, advance)
        for path, text in self.lists.items():
            atomic.replace_text(path, text)


def _write(
    part: Part,
    generator: Generator,
    pool: ProcessPoolExecutor | None,
    advance: Callable[[int], None],
) -> None:
    """Write one part."""

    def rows() -> Iterator[Columns]:
        for frames in generate(part.rows, generator, pool, part.start):
            yield frames.arrays()
            advance(len(frames))

    parts.write_part(
        part, part.rows, rows(), {"seed": generator.seed, "description": generator.description}
    )
