"""Write a published split in the files that nets read: its parts, their list, and a list of bad frames.

Crops are made on threads, a few chunks ahead of the writer.
"""

from __future__ import annotations

import collections
import contextlib
import json
from collections import Counter
from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from handpose.datasets import parts as files
from handpose.datasets.frames import Frames
from handpose.datasets.parts import Columns, Part, is_whole, write_part
from handpose.datasets.published_frames import PublishedFrames, statistics
from handpose.frames.crops import SIZE
from handpose.frames.images import BadFrameError
from netlib.errors import DataError, printable
from netlib.files import atomic, hdf5
from netlib.files.paths import exists

_CHUNK = 16  # frames per chunk
_AHEAD = 8  # chunks ahead of the writer, per thread

Chunk = tuple[int, Frames, list[tuple[int, BadFrameError]]]  # number of frames, the good ones, the bad ones


@dataclass
class Outcome:
    """The result of preparing a split."""

    index: list[int] = field(default_factory=list)  # numbers of the good frames
    bad: dict[int, str] = field(default_factory=dict)  # kind by index
    made: int = 0  # number of new good frames


def is_current(frames: PublishedFrames, part: Part) -> bool:
    """True if a part is complete and every frame that it leaves out still has the same error.

    The recipe has the images' sizes only, so a repaired image may not change it.
    """
    return is_whole(part) and all(frames.flaw(i) == kind for i, kind in _left_out(part))


def _left_out(part: Part) -> list[tuple[int, str]]:
    """The frames that a complete part leaves out: index and kind of error."""
    with hdf5.opened(part.path, "the data") as file:
        kinds = json.loads(file.attrs["bad"])
    return [(i, kind) for kind, indices in kinds.items() for i in indices]


class PreparedSplit:
    """One split in a folder.

    frames   to prepare
    parts    the HDF5 files; ``missing`` are those to be written, all if ``force``
    list     the text file that names them: SPLIT.txt
    bad      the text file that names the bad frames, if there are any: bad_SPLIT.txt
    """

    def __init__(self, frames: PublishedFrames, out: Path, force: bool = False) -> None:
        self.frames = frames
        self.parts = []
        for i, start in enumerate(range(0, len(frames), files.FRAMES_PER_FILE)):
            stop = min(start + files.FRAMES_PER_FILE, len(frames))
            self.parts.append(Part(out / f"{frames.split}_{i:03d}.h5", stop - start, frames.recipe(start, stop)))
        self.missing = [part for part in self.parts if force or not is_current(frames, part)]
        self.list, self.bad = out / f"{frames.split}.txt", out / f"bad_{frames.split}.txt"

    def write(
        self, workers: int, advance: Callable[[int], None], on_bad: Callable[[int, BadFrameError], None]
    ) -> Outcome:
        """Write the missing parts, and name the bad frames.

        workers  number of threads
        advance  is called with the number of further frames
        on_bad   is called for every bad frame with its index, for those of parts that were kept, too

        An exception of ``advance`` or ``on_bad`` ends the run and keeps whole parts only.
        """
        outcome, named, start = Outcome(), list[str](), 0

        def report(i: int, error: BadFrameError) -> None:
            on_bad(i, error)
            outcome.bad[i] = error.kind
            named.append(f"frame {i}: {error}\n")

        if self.missing:
            self.list.unlink(missing_ok=True)  # no list may name files of two kinds
        with ThreadPoolExecutor(workers, "prepare") as pool:
            for part in self.parts:
                if part in self.missing:
                    chunks = self._chunks(pool, _AHEAD * workers, start, part.rows)
                    index = self._write_part(part, chunks, advance, report)
                    outcome.made += len(index)
                else:
                    with hdf5.opened(part.path, "the data") as file:
                        index = file["index"][...].tolist()
                    for i, kind in _left_out(part):
                        report(i, BadFrameError(self.frames.files[i], kind))
                outcome.index += index
                start += part.rows
        if named:
            atomic.replace_text(self.bad, "".join(named))
        else:
            self.bad.unlink(missing_ok=True)
        return outcome

    def _write_part(
        self, part: Part, chunks: Generator[Chunk, None, None], advance: Callable[[int], None],
        on_bad: Callable[[int, BadFrameError], None],
    ) -> list[int]:
        """Write a part of these chunks; returns the numbers of its frames."""
        frames, index, bad = self.frames, list[int](), dict[str, list[int]]()

        def pieces() -> Iterator[Columns]:
            with contextlib.closing(chunks):
                for count, good, failed in chunks:
                    for i, error in failed:
                        bad.setdefault(error.kind, []).append(i)
                        on_bad(i, error)
                    index.extend(good.index.tolist())
                    yield good.arrays()
                    advance(count)

        def attributes() -> dict[str, object]:
            description = (
                f"{frames.made_from} {frames.split} frames; crops {SIZE} x {SIZE} in [-1, 1] about {frames.centre}, "
                "joints in half-cubes from there (camera axes, x right, y up, z away); lengths in mm."
            )
            # "bad": the frames that were left out
            return {"made_from": frames.made_from, "description": description, "bad": json.dumps(bad)}

        write_part(part, frames.columns(), pieces(), attributes)
        return index

    def _chunks(self, pool: ThreadPoolExecutor, ahead: int, start: int, rows: int) -> Generator[Chunk, None, None]:
        """The chunks of frames from ``start`` on, in order; while OpenCV decodes for one, other threads run."""
        begun: collections.deque[tuple[int, Future[Any]]] = collections.deque()
        try:
            for first in range(start, start + rows, _CHUNK):
                last = min(first + _CHUNK, start + rows)
                begun.append((last - first, pool.submit(self.frames.crops, first, last)))
                if len(begun) > ahead:
                    count, future = begun.popleft()
                    yield count, *future.result()
            while begun:
                count, future = begun.popleft()
                yield count, *future.result()
        finally:
            for _, future in begun:
                future.cancel()

    def write_list(self, outcome: Outcome) -> None:
        """Write the list of the parts that have frames. Raises DataError if none has."""
        if not outcome.index:
            folder, split = self.frames.files[0].parent, self.frames.split
            raise DataError(f"{folder}: none of the {len(self.frames)} {split} frames can be used")
        used = {i // files.FRAMES_PER_FILE for i in outcome.index}
        some = [part.path for n, part in enumerate(self.parts) if n in used]  # HDF5Data rejects files without rows
        atomic.replace_text(self.list, files.list_text(some))

    def report(self, outcome: Outcome) -> str:
        """The result of the preparation, in two lines."""
        counts = ", ".join(f"{count} {kind}" for kind, count in sorted(Counter(outcome.bad.values()).items()))
        bad = f", {len(outcome.bad)} bad frames left out: {counts}" if counts else ", none bad"
        split = self.frames.split
        head = f"{split}: {len(outcome.index)} frames ({printable(self.frames.made_from)}){bad}"
        return f"{head}\n{split}: {statistics(self.frames, outcome.index)}"


def refuse_foreign(splits: Sequence[PreparedSplit], own: Sequence[str], force: bool = False) -> None:
    """Raise DataError if a file to be replaced holds data of an origin that is not in ``own``, or rendered frames.

    With ``force`` only folders and devices raise.
    """
    every = [part.path for split in splits for part in split.parts]
    files.refuse_foreign(every, [split.list for split in splits], own, force)
    rendered = [path for path in every if exists(path) and "bad" not in (files.attributes(path) or {})]
    if rendered and not force:  # rendered ones have no frames that were left out
        raise DataError(f"{rendered[0]}: holds rendered frames (make_synthetic); choose another --out, or use --force "
                        "to replace it")
