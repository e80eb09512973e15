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
from typing import Any, NamedTuple, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from handpose.datasets import nyu_files, parts
from handpose.datasets.parts import Columns, Part
from handpose.synthetic.generator import BLOCK, Split
from netlib.blob import Array
from netlib.errors import DataError
from netlib.files import atomic

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

    ``workers`` is a number of processes, or a pool made by ``processes`` for several calls. The frames and
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


# ---------------------------------------------------------------------------------------------- files

MADE_FROM = nyu_files.SYNTHETIC


class Piece(NamedTuple):
    """A part and its frames: those of a generator from number ``start`` on."""

    part: Part
    generator: Source[Any]
    start: int


def pieces_of(generator: Source[Any], count: int, out: Path) -> list[Piece]:
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

    def __init__(self, out: Path, sources: Sequence[tuple[Source[Any], int]], force: bool = False) -> None:
        self._rows = [(count, generator.columns()) for generator, count in sources]
        parts.check_space(out, self._rows)  # at once
        pieces = {generator.split: pieces_of(generator, count, out) for generator, count in sources}
        every = [piece for some in pieces.values() for piece in some]
        self.out = out
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
            parts.check_space(self.out, self._rows)
            for path in self.lists:
                path.unlink(missing_ok=True)  # no list may name files of two kinds
            self._write_parts(workers, advance)
        for path, text in self.lists.items():
            atomic.replace_text(path, text)

    def _write_parts(self, workers: int, advance: Callable[[int], None]) -> None:
        with contextlib.ExitStack() as stack:
            pool = stack.enter_context(processes(workers)) if workers > 1 else 1

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
