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

    parts: list[Part]
    index: list[int] = field(default_factory=list)  # numbers of the good frames
    bad: dict[int, str] = field(default_factory=dict)  # kind by index
    made: int = 0  # number of new good frames


def parts_of(frames: PublishedFrames, out: Path) -> list[Part]:
    """The parts of a split."""
    parts = []
    for i, start in enumerate(range(0, len(frames), files.FRAMES_PER_FILE)):
        stop = min(start + files.FRAMES_PER_FILE, len(frames))
        parts.append(Part(out / f"{frames.split}_{i:03d}.h5", stop - start, frames.recipe(start, stop)))
    return parts


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


def write_parts(
    frames: PublishedFrames,
    parts: Sequence[Part],
    missing: Sequence[Part],
    workers: int,
    advance: Callable[[int], None],
    on_bad: Callable[[int, BadFrameError], None],
) -> Outcome:
    """Write the missing parts of a split and keep the others.

    workers  number of threads
    advance  is called with the number of further frames
    on_bad   is called for every bad frame with its index, for those of parts that were kept, too

    An exception of ``advance`` or ``on_bad`` ends the run and keeps whole parts only.
    """
    with ThreadPoolExecutor(workers, "prepare") as pool:
        writer = _Writer(frames, Outcome(list(parts)), pool, _AHEAD * workers, advance, on_bad)
        start = 0
        for part in parts:
            if part in missing:
                writer.write(part, start)
            else:
                writer.recall(part)
            start += part.rows
    return writer.outcome


@dataclass
class _Writer:
    """Writes one part after the other."""

    frames: PublishedFrames
    outcome: Outcome
    pool: ThreadPoolExecutor
    ahead: int  # number of chunks in progress
    advance: Callable[[int], None]
    on_bad: Callable[[int, BadFrameError], None]

    def recall(self, part: Part) -> None:
        """Read the result of a part from its file."""
        with hdf5.opened(part.path, "the data") as file:
            self.outcome.index += file["index"][...].tolist()
        for i, kind in _left_out(part):
            self.outcome.bad[i] = kind
            self.on_bad(i, BadFrameError(self.frames.files[i], kind))

    def write(self, part: Part, start: int) -> None:
        """Write a part of the frames from ``start`` on."""
        frames, index = self.frames, list[int]()
        bad: dict[int, str] = {}

        def pieces() -> Iterator[Columns]:
            with contextlib.closing(self._chunks(start, start + part.rows)) as chunks:
                for count, good, failed in chunks:
                    for i, error in failed:
                        bad[i] = error.kind
                        self.on_bad(i, error)
                    index.extend(good.index.tolist())
                    yield good.arrays()
                    self.advance(count)

        def attributes() -> dict[str, object]:
            kinds: dict[str, list[int]] = {}
            for i, kind in bad.items():
                kinds.setdefault(kind, []).append(i)
            description = (
                f"{frames.made_from} {frames.split} frames; crops {SIZE} x {SIZE} in [-1, 1] about {frames.centre}, "
                "joints in half-cubes from there (camera axes, x right, y up, z away); lengths in mm."
            )
            # "bad": the frames that were left out
            return {"made_from": frames.made_from, "description": description, "bad": json.dumps(kinds)}

        write_part(part, frames.columns(), pieces(), attributes)
        self.outcome.index += index
        self.outcome.bad.update(bad)
        self.outcome.made += len(index)

    def _chunks(self, start: int, stop: int) -> Generator[Chunk, None, None]:
        """All chunks in order; while OpenCV decodes for one, other threads run."""
        begun: collections.deque[tuple[int, Future[Any]]] = collections.deque()
        try:
            for first in range(start, stop, _CHUNK):
                last = min(first + _CHUNK, stop)
                begun.append((last - first, self.pool.submit(self.frames.crops, first, last)))
                if len(begun) > self.ahead:
                    count, future = begun.popleft()
                    yield count, *future.result()
            while begun:
                count, future = begun.popleft()
                yield count, *future.result()
        finally:
            for _, future in begun:
                future.cancel()


class PreparedSplit:
    """One split in a folder.

    frames   to prepare
    parts    the HDF5 files; ``missing`` are those to be written, all if ``force``
    list     the text file that names them: SPLIT.txt
    bad      the text file that names the bad frames, if there are any: bad_SPLIT.txt
    """

    def __init__(self, frames: PublishedFrames, out: Path, force: bool = False) -> None:
        self.frames = frames
        self.parts = parts_of(frames, out)
        self.missing = [part for part in self.parts if force or not is_current(frames, part)]
        self.list, self.bad = out / f"{frames.split}.txt", out / f"bad_{frames.split}.txt"

    def write(
        self, workers: int, advance: Callable[[int], None], on_bad: Callable[[int, BadFrameError], None]
    ) -> Outcome:
        """Write the missing parts, and name the bad frames; arguments as for ``write_parts``."""
        named: list[str] = []

        def name(i: int, error: BadFrameError) -> None:
            on_bad(i, error)
            named.append(f"frame {i}: {error}\n")

        if self.missing:
            self.list.unlink(missing_ok=True)  # no list may name files of two kinds
        outcome = write_parts(self.frames, self.parts, self.missing, workers, advance, name)
        if named:
            atomic.replace_text(self.bad, "".join(named))
        else:
            self.bad.unlink(missing_ok=True)
        return outcome

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
