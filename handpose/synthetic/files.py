"""Synthetic rows as a data set on disk: parts of some thousand frames, and a list of them for each split.

Existing parts of the same data are kept, so an interrupted run continues where it stopped, and a second run does
nothing.
"""

from __future__ import annotations

import contextlib
import json
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from handpose.datasets import nyu_files, parts
from handpose.datasets.parts import Columns, Part
from handpose.synthetic.many import Source, generate, processes
from netlib.errors import DataError
from netlib.files import atomic

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
        parts.check_rows(out, [(count, generator.columns()) for generator, count in sources])  # at once
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
            parts.check_space(self.out, [piece.part for piece in self.missing], self.missing[0].generator.columns())
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
