"""Synthetic frames as a data set on disk: parts of some thousand frames, and a list of them for each split.

What is there and the same is kept, so an interrupted run goes on where it stopped, and a second one has nothing to do.
"""

from __future__ import annotations

import contextlib
import json
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import NamedTuple

from handpose.data import nyu_files, parts
from handpose.data.parts import Columns, Part
from handpose.synthetic.generator import RECIPES, Generator, Recipe, Split
from handpose.synthetic.many import generate
from handpose.synthetic.workers import processes
from netlib import atomic

MADE_FROM = nyu_files.SYNTHETIC
DESCRIPTION = (
    "Rendered capsule hands with a depth camera's noise; crops 128 x 128 in [-1, 1], joints in half-cubes from the "
    "crop centre (camera axes, x right, y up, z away), dof: the hand model's inputs; lengths in mm."
)


class Piece(NamedTuple):
    """A part, and which frames it is made of: those of a generator from number ``start`` on."""

    part: Part
    generator: Generator
    start: int


def pieces_of(generator: Generator, count: int, out: Path) -> list[Piece]:
    """The files in the folder ``out`` that the first ``count`` frames of a generator become."""
    pieces = []
    for i, start in enumerate(range(0, count, parts.FRAMES_PER_FILE)):
        rows = min(parts.FRAMES_PER_FILE, count - start)
        recipe = json.dumps({**generator.made_from(), "start": start, "frames": rows}, sort_keys=True)
        pieces.append(Piece(Part(out / f"{generator.split}_{i:03d}.h5", rows, recipe), generator, start))
    return pieces


class DataSet:
    """Synthetic frames of some splits as files in a folder.

    out      the folder
    counts   frames per split
    recipe   what they are drawn by
    force    write everything anew, and replace data of another origin

    Raises DataError where data of another origin would be replaced.
    """

    def __init__(
        self, out: Path, seed: int, counts: Mapping[Split, int], recipe: Recipe = RECIPES["nyu"], force: bool = False
    ) -> None:
        pieces = {split: pieces_of(Generator(seed, split, recipe), count, out) for split, count in counts.items()}
        every = [piece for some in pieces.values() for piece in some]
        self.out = out
        self.lists = {out / f"{split}.txt": parts.list_text(p.part.path for p in pieces[split]) for split in pieces}
        if not force:
            parts.refuse_foreign([piece.part.path for piece in every], list(self.lists), [MADE_FROM])
        self.missing = [piece for piece in every if force or not parts.is_whole(piece.part)]

    @property
    def is_whole(self) -> bool:
        """Is nothing left to be written?"""
        return not self.missing and all(atomic.text_of(path) == text for path, text in self.lists.items())

    @property
    def missing_frames(self) -> int:
        """How many frames are to be written."""
        return sum(piece.part.rows for piece in self.missing)

    def write(self, workers: int, advance: Callable[[int], None]) -> None:
        """Write what is missing, then the lists. Raises DataError, OSError.

        workers  number of processes
        advance  is told how many frames more are done; an exception of it ends the run and keeps whole files only.
        """
        if self.missing:
            for path in self.lists:
                path.unlink(missing_ok=True)  # no list may name files of two kinds
            parts.check_space(self.out, [piece.part for piece in self.missing], self.missing[0].generator.columns())
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
                facts = {"made_from": MADE_FROM, "seed": piece.generator.seed, "description": DESCRIPTION}
                parts.write_part(piece.part, piece.generator.columns(), rows(piece), lambda facts=facts: facts)  # type: ignore[misc]
