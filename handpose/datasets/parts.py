"""Data sets on disk: HDF5 files that are complete or absent.

A data set consists of a few files ("parts") of some thousand frames each, and a list that names
them, which HDF5Data reads. A part is written under a temporary name, synced and then renamed. It
stores its *recipe*, a text of everything that it depends on: a part with the right recipe is kept,
so an interrupted run continues where it stopped.
"""

from __future__ import annotations

import errno
import itertools
import json
import os
import re
import shutil
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from netlib.blob import Array, divide_up
from netlib.errors import DataError, system_error_of
from netlib.files import atomic, hdf5
from netlib.files.paths import exists, names_in

Columns = Mapping[str, Array]  # data sets by name; rows first

FRAMES_PER_FILE = 2500  # the last file may have fewer
_PAGE = 1 << 16  # approximate size of a file beyond its rows


@dataclass(frozen=True)
class Part:
    """A file to be written."""

    path: Path
    start: int  # number of its first row in the split
    rows: int  # maximum number of rows; some may be left out
    made_from: str  # the source of its rows
    recipe: str  # all that the file depends on


def parts_of(
    out: Path,
    split: str,
    count: int,
    made_from: str,
    recipe: Callable[[int, int], Mapping[str, object]],
) -> list[Part]:
    """The parts in a folder for ``count`` rows of a split; ``recipe`` gives that of some rows: the
    first, their number.
    """
    found = []
    for i, start in enumerate(range(0, count, FRAMES_PER_FILE)):
        rows = min(FRAMES_PER_FILE, count - start)
        text = json.dumps({**recipe(start, rows), "start": start, "frames": rows}, sort_keys=True)
        found.append(Part(out / f"{split}_{i:03d}.h5", start, rows, made_from, text))
    return found


def attributes(path: Path) -> dict[str, Any] | None:
    """The attributes of an HDF5 file, or None if it is not one."""
    try:
        with hdf5.opened(path, "the data") as file:
            return dict(file.attrs)
    except DataError as error:
        if system_error_of(error):
            raise
        return None


def missing_of(wanted: Sequence[Part], lists: Sequence[Path], force: bool = False) -> list[Part]:
    """The parts that are not there with their recipe, to be written; all with ``force``.

    A file in a part's place is replaced if it was made from the same source, a list if all
    names in it are those of parts. Raises DataError for anything else; with ``force`` only for
    folders and devices.
    """
    for path in (*(part.path for part in wanted), *lists):
        if exists(path) and not path.is_file():
            raise DataError(f"{path}: is not a file; move it away, or choose another --out")
    if force:
        return list(wanted)
    instead = "choose another --out, or use --force to replace it"
    for path in lists:
        for name in listed_names(path):
            if not re.fullmatch(rf"{path.stem}_\d+\.h5", name):
                raise DataError(
                    f"{path}: names {name!r}, expected {path.stem}_000.h5, ...; {instead}"
                )
    missing = []
    for part in wanted:
        found = attributes(part.path) if exists(part.path) else {}
        if found is None:
            raise DataError(f"{part.path}: not a readable HDF5 file; {instead}")
        if str(found.get("recipe")) == part.recipe:
            continue
        if exists(part.path):
            there = _source(found.get("made_from", "an unknown source"), found.get("recipe"))
            if there != (expected := _source(part.made_from, part.recipe)):
                raise DataError(
                    f"{part.path}: holds data made from {there}, expected {expected}; {instead}"
                )
        missing.append(part)
    return missing


def _source(made_from: object, recipe: object) -> str:
    """What rows are made from, in words: for synthetic ones also the skeleton, which
    their recipe names.
    """
    skeleton = re.search(r'"skeleton": "([^"]*)"', str(recipe))
    return f"{made_from}{f' frames of {skeleton[1]}' if skeleton else ''}"


def listed_names(path: Path) -> list[str]:
    """The names, without folders, of the files in a list; none if there is no list.

    Raises DataError.
    """
    return [
        Path(line.strip()).name for line in (atomic.text_of(path) or "").split("\n") if line.strip()
    ]


def list_text(paths: Iterable[Path]) -> str:
    """The content of a list of files."""
    return "".join(f"{path.as_posix()}\n" for path in paths)


def row_bytes(columns: Columns) -> int:
    """Bytes of one row of all data sets."""
    return sum(int(np.prod(a.shape[1:])) * a.dtype.itemsize for a in columns.values())


def check_space(out: Path, rows: Sequence[tuple[int, Columns]]) -> None:
    """Raise DataError if the disk of a folder, which need not exist, is too small for parts of
    these numbers of rows.

    The files that are there are taken for parts that are kept or replaced.
    """
    need = sum(count * row_bytes(columns) for count, columns in rows)
    need += sum(divide_up(count, FRAMES_PER_FILE) for count, _ in rows) * _PAGE
    there = [out / name for name in names_in(out) if name.endswith(".h5")]
    need -= sum(path.stat().st_size for path in there if path.is_file())
    free = shutil.disk_usage(
        next(place for place in (out, *out.absolute().parents) if exists(place))
    ).free
    if need > free:
        raise DataError(f"{out}: needs {round(need, -6) // 10**6} MB, {free / 1e6:.0f} MB are free")


def write_part(
    part: Part, rows: int, pieces: Iterable[Columns], attributes: Mapping[str, object]
) -> None:
    """Write the rows that ``pieces`` yield, at least one piece, and further
    attributes of the file.
    """

    def fill(path: Path) -> None:
        written = 0
        several = iter(pieces)
        first = next(several)
        with _created(path, rows, first) as file:
            for piece in itertools.chain([first], several):
                count = len(next(iter(piece.values())))
                for name, values in piece.items():
                    file[name][written : written + count] = values
                written += count
            file.attrs.update({"made_from": part.made_from, **attributes, "recipe": part.recipe})

    atomic.replace(part.path, fill)


def _created(path: Path, rows: int, columns: Columns) -> h5py.File:
    """A new file of data sets without content; they begin on whole pages, which is fastest for
    reads and memory maps.

    Raises OSError if the disk has no room for the rows, since HDF5 does not survive a
    failing write.
    """
    with path.open("wb") as stream:
        if hasattr(os, "posix_fallocate"):
            try:
                os.posix_fallocate(stream.fileno(), 0, rows * row_bytes(columns) + _PAGE)
            except OSError as error:
                if error.errno not in (errno.EINVAL, errno.EOPNOTSUPP):  # some file systems cannot
                    raise
    file = h5py.File(path, "w", alignment_threshold=1 << 16, alignment_interval=4096)
    for name, array in columns.items():
        file.create_dataset(name, (rows, *array.shape[1:]), array.dtype)
    return file
