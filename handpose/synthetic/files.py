"""Synthetic rows in any number: drawn block by block by worker processes, and as a data set on disk.

A data set consists of parts of some thousand rows, and a list of them for each split. Existing parts of the same data
are kept, so an interrupted run continues where it stopped, and a second run does nothing.
"""

from __future__ import annotations

import collections
import contextlib
import json
import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import NamedTuple

from handpose.datasets import nyu_files, parts
from handpose.datasets.frames import Frames
from handpose.datasets.parts import Columns, Part
from handpose.synthetic.generator import BLOCK, Generator
from netlib.errors import DataError
from netlib.files import atomic

_AHEAD = 16  # blocks drawn ahead of the consumer, 4 MB each


def generate(
    count: int, generator: Generator, pool: ProcessPoolExecutor | None = None, start: int = 0
) -> Iterator[Frames]:
    """Frames ``start`` to ``start + count`` of a generator, in pieces of at most ``BLOCK``. Raises DataError.

    ``pool`` is made by ``processes``; the frames and their order do not depend on it. Processes are spawned, so a
    script with a pool needs the usual ``if __name__ == "__main__":``.
    """
    numbers = range(start // BLOCK, -(-(start + count) // BLOCK))
    blocks = map(generator.block, numbers) if pool is None else _in_processes(generator, numbers, pool)
    for frames in blocks:
        first = int(frames.index[0])
        yield frames.rows(slice(max(start - first, 0), start + count - first))


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


# ---------------------------------------------------------------------------------------------- processes

@contextlib.contextmanager
def processes(workers: int) -> Iterator[ProcessPoolExecutor]:
    """A pool whose processes end with their parent. Submit within ``no_interrupt``; otherwise Ctrl-C reaches them."""
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


# ---------------------------------------------------------------------------------------------- files

MADE_FROM = nyu_files.SYNTHETIC


class Piece(NamedTuple):
    """A part and its frames: those of a generator from number ``start`` on."""

    part: Part
    generator: Generator
    start: int


def pieces_of(generator: Generator, count: int, out: Path) -> list[Piece]:
    """The parts in the folder ``out`` for the first ``count`` frames of a generator."""
    pieces, made_from = [], generator.made_from()
    for i, start in enumerate(range(0, count, parts.FRAMES_PER_FILE)):
        rows = min(parts.FRAMES_PER_FILE, count - start)
        recipe = json.dumps({**made_from, "start": start, "frames": rows}, sort_keys=True)
        pieces.append(Piece(Part(out / f"{generator.split}_{i:03d}.h5", rows, recipe), generator, start))
    return pieces


def _kind_of(recipe: object) -> str | None:
    """The output of a recipe, in words: frames of a skeleton file; None if unknown."""
    try:
        return f"frames of {json.loads(str(recipe))['prior']['skeleton']}"
    except (ValueError, KeyError, TypeError):
        return None


def _refuse_another_kind(part: Part) -> None:
    """Raise DataError if the part's file has frames of another body."""
    found = parts.attributes(part.path) if part.path.is_file() else None
    there, asked = _kind_of((found or {}).get("recipe")), _kind_of(part.recipe)
    if there and there != asked:
        raise DataError(f"{part.path}: holds {there}, expected {asked}; choose another folder, or use --force to "
                        "replace it")


class DataSet:
    """Synthetic rows of some splits as files in a folder.

    out      the folder
    sources  a generator and the number of its rows for each split
    force    write everything again, and replace data of another origin

    Raises DataError where data of another origin or kind would be replaced, and if the disk is full.
    """

    def __init__(self, out: Path, sources: Sequence[tuple[Generator, int]], force: bool = False) -> None:
        parts.check_space(out, [(count, generator.columns()) for generator, count in sources])
        pieces = {generator.split: pieces_of(generator, count, out) for generator, count in sources}
        every = [piece for some in pieces.values() for piece in some]
        self.lists = {out / f"{split}.txt": parts.list_text(p.part.path for p in pieces[split]) for split in pieces}
        parts.refuse_foreign([piece.part.path for piece in every], list(self.lists), [MADE_FROM], force)
        for piece in () if force else every:
            _refuse_another_kind(piece.part)
        self.missing = [piece for piece in every if force or not parts.is_whole(piece.part)]

    @property
    def is_whole(self) -> bool:
        """True if nothing is left to be written."""
        return not self.missing and all(atomic.text_of(path) == text for path, text in self.lists.items())

    @property
    def missing_frames(self) -> int:
        """The number of frames to be written."""
        return sum(piece.part.rows for piece in self.missing)

    def write(self, workers: int, advance: Callable[[int], None]) -> None:
        """Write the missing parts, then the lists. Raises DataError, OSError.

        workers  number of processes
        advance  called with the number of further frames; its exceptions end the run and keep complete files only.
        """
        if self.missing:
            for path in self.lists:
                path.unlink(missing_ok=True)  # no list may name files of two kinds
            self._write_parts(workers, advance)
        for path, text in self.lists.items():
            atomic.replace_text(path, text)

    def _write_parts(self, workers: int, advance: Callable[[int], None]) -> None:
        with contextlib.ExitStack() as stack:
            pool = stack.enter_context(processes(workers)) if workers > 1 else None

            def rows(piece: Piece) -> Iterator[Columns]:
                for frames in generate(piece.part.rows, piece.generator, pool, piece.start):
                    yield frames.arrays()
                    advance(len(frames))

            for piece in self.missing:
                facts = {
                    "made_from": MADE_FROM,
                    "seed": piece.generator.seed,
                    "description": piece.generator.description,
                }
                parts.write_part(piece.part, piece.generator.columns(), rows(piece), lambda facts=facts: facts)  # type: ignore[misc]
