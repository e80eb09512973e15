"""Data sets on disk: HDF5 files that are complete or absent.

A data set consists of a few files ("parts") of some thousand frames each, and a list that names them, which HDF5Data
reads. A part is laid out by HDF5, filled by plain writes under a temporary name, synced and then renamed. It stores its
*recipe*, a text of everything that it depends on: a part with the right recipe is kept, so an interrupted run continues
where it stopped.
"""

from __future__ import annotations

import errno
import io
import os
import shutil
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from netlib.blob import Array
from netlib.errors import DataError, system_error_of
from netlib.files import atomic, hdf5
from netlib.files.paths import exists, find, names_in

Columns = Mapping[str, Array]  # data sets by name; rows first

FRAMES_PER_FILE = 2500  # the last file may have fewer
_COPY = 64  # rows copied at a time
_PAGE = 1 << 16  # approximate size of a file beyond its rows


@dataclass(frozen=True)
class Part:
    """A file to be written."""

    path: Path
    rows: int  # maximum number of rows
    recipe: str  # all that the file depends on


def attributes(path: Path) -> dict[str, Any] | None:
    """The attributes of an HDF5 file, or None if it is not one."""
    try:
        with hdf5.opened(path, "the data") as file:
            return dict(file.attrs)
    except DataError as error:
        if system_error_of(error):
            raise
        return None


def is_whole(part: Part) -> bool:
    """True if the file exists and was made by the same recipe."""
    found = attributes(part.path) if part.path.is_file() else None
    return found is not None and found.get("recipe") == part.recipe


def listed(path: Path, own: Sequence[Path]) -> list[Path]:
    """The files in a list, relative to the working directory or to the list's folder; empty if there is no list.

    Those of ``own`` may be named relative to any working directory, and may be missing. Raises DataError.
    """
    by_name, found = {file.name: file for file in own}, []
    for line in filter(None, map(str.strip, (atomic.text_of(path) or "").split("\n"))):
        file = find(line, str(path))
        if not exists(file) and (same := by_name.get(file.name)):
            file = same if same.absolute().parts[-len(file.parts) :] == file.parts else file
        found.append(file)
    return found


def refuse_foreign(files: Sequence[Path], lists: Sequence[Path], own: Sequence[str], force: bool = False) -> None:
    """Raise DataError if a file to be replaced, or one in a list to be replaced, is not of ``own`` origin.

    With ``force`` only folders and devices raise.
    """
    for path in (*files, *lists):
        if exists(path) and not path.is_file():
            raise DataError(f"{path}: is not a file; move it away, or choose another --out")
    if force:
        return
    listing = {file: path for path in lists for file in listed(path, files)} | dict.fromkeys(files)
    for path, by in listing.items():
        if not exists(path):
            if by:
                raise DataError(f"{by}: names {str(path)!r}, which is not there; move the list away, choose another "
                                "--out, or use --force to replace it")
            continue
        found = attributes(path)
        if found is None:
            raise DataError(f"{path}: not a readable HDF5 file; move it away, choose another --out, or use --force")
        origin = str(found.get("made_from", "an unknown source"))
        if origin not in own:
            raise DataError(
                f"{path}: holds data made from {origin}; choose another --out, or use --force to replace it"
            )


def list_text(paths: Iterable[Path]) -> str:
    """The content of a list of files."""
    return "".join(f"{path.as_posix()}\n" for path in paths)


def row_bytes(columns: Columns) -> int:
    """Bytes of one row of all data sets."""
    return sum(int(np.prod(a.shape[1:])) * a.dtype.itemsize for a in columns.values())


def check_space(out: Path, parts: Sequence[Part], columns: Columns) -> None:
    """Raise DataError before any work if the disk is too small."""
    replaced = sum(part.path.stat().st_size for part in parts if part.path.is_file())
    check_room(out, bytes_of(parts, columns) - replaced)


def bytes_of(parts: Sequence[Part], columns: Columns) -> int:
    """The size of parts on disk."""
    return sum(part.rows * row_bytes(columns) + _PAGE for part in parts)


def check_room(out: Path, need: int) -> None:
    """Raise DataError if the disk of a folder, which need not exist, has fewer than ``need`` free bytes."""
    free = shutil.disk_usage(next(place for place in (out, *out.absolute().parents) if exists(place))).free
    if need > free:
        raise DataError(f"{out}: needs {round(need, -6) // 10**6} MB, {free / 1e6:.0f} MB are free")


def check_rows(out: Path, rows: Sequence[tuple[int, Columns]]) -> None:
    """Check the disk space for numbers of rows, assuming that existing files are kept or replaced."""
    need = sum(count * row_bytes(columns) + -(-count // FRAMES_PER_FILE) * _PAGE for count, columns in rows)
    there = [out / name for name in names_in(out) if name.endswith(".h5")]
    check_room(out, need - sum(path.stat().st_size for path in there if path.is_file()))


def write_part(
    part: Part, columns: Columns, pieces: Iterable[Columns], attributes: Callable[[], Mapping[str, object]]
) -> int:
    """Write the rows that ``pieces`` yield; returns their number, at most ``part.rows``.

    columns     arrays without rows, of the shapes and types of those in ``pieces``
    attributes  called for the attributes of the file before the pieces, and again after them if their rows are fewer
    """
    written = 0

    def fill(path: Path) -> None:
        nonlocal written
        written = _fill(path, part.rows, columns, pieces, {**attributes(), "recipe": part.recipe})
        if written < part.rows:
            _shorten(path, written, columns, {**attributes(), "recipe": part.recipe})

    atomic.replace(part.path, fill)
    return written


def _shorten(path: Path, rows: int, columns: Columns, attributes: Mapping[str, object]) -> None:
    """Keep the first ``rows`` rows of a file; HDF5 cannot truncate data sets, so they are copied."""

    def fill(short: Path) -> None:
        with path.open("rb") as file:
            _fill(short, rows, columns, _rows(file, _offsets(path), columns, rows), attributes)

    atomic.replace(path, fill, sync=False)


def _fill(path: Path, rows: int, columns: Columns, pieces: Iterable[Columns], attributes: Mapping[str, object]) -> int:
    """Let HDF5 lay out the file, and fill it by plain writes: a failing write within HDF5 can crash the process.

    Returns the number of rows.
    """
    with path.open("wb") as file:
        _reserve(file.fileno(), rows * row_bytes(columns) + _PAGE)
    offsets = _lay_out(path, rows, columns, attributes)
    done = 0
    with path.open("r+b") as file:
        _reserve(file.fileno(), path.stat().st_size)
        for piece in pieces:
            count = len(next(iter(piece.values())))
            if not count:
                continue
            for name, array in piece.items():
                file.seek(offsets[name] + done * array[0].nbytes)
                file.write(np.ascontiguousarray(array).data)
            done += count
    return done


def _lay_out(path: Path, rows: int, columns: Columns, attributes: Mapping[str, object]) -> dict[str, int]:
    """Write the file with empty data sets; returns their offsets."""
    plist = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
    plist.set_alloc_time(h5py.h5d.ALLOC_TIME_EARLY)
    plist.set_fill_time(h5py.h5d.FILL_TIME_NEVER)
    # Data sets begin on whole pages, which is fastest for reads and memory maps.
    image = _Sparse()
    with h5py.File(image, "w", alignment_threshold=1 << 16, alignment_interval=4096) as file:
        for name, value in attributes.items():
            file.attrs[name] = value
        for name, array in columns.items():
            file.create_dataset(name, (rows, *array.shape[1:]), array.dtype, dcpl=plist)
    with path.open("r+b") as out:
        for first, piece in image.pieces:
            out.seek(first)
            out.write(piece)
        out.truncate(image.size)
    return _offsets(path)


class _Sparse(io.RawIOBase):
    """A file in memory that keeps only what is written, so that it can be larger than the memory.

    pieces  offsets and bytes, in the order of writing
    size    in bytes
    """

    def __init__(self) -> None:
        self.pieces: list[tuple[int, bytes]] = []
        self.size = self._at = 0

    def seek(self, offset: int, whence: int = os.SEEK_SET) -> int:
        self._at = offset + {os.SEEK_SET: 0, os.SEEK_CUR: self._at, os.SEEK_END: self.size}[whence]
        return self._at

    def tell(self) -> int:
        return self._at

    def write(self, content: Any) -> int:
        piece = bytes(content)
        self.pieces.append((self._at, piece))
        self._at += len(piece)
        self.size = max(self.size, self._at)
        return len(piece)

    def readinto(self, buffer: Any) -> int:
        out = memoryview(buffer).cast("B")
        count = max(0, min(len(out), self.size - self._at))
        out[:count] = bytes(count)
        for first, piece in self.pieces:
            begin, end = max(first, self._at), min(first + len(piece), self._at + count)
            if begin < end:
                out[begin - self._at : end - self._at] = piece[begin - first : end - first]
        self._at += count
        return count

    def truncate(self, size: int | None = None) -> int:
        self.size = self._at if size is None else size
        return self.size


def _offsets(path: Path) -> dict[str, int]:
    with h5py.File(path, "r", locking=False) as file:
        return {name: file[name].id.get_offset() for name in file}


def _rows(file: Any, offsets: Mapping[str, int], columns: Columns, rows: int) -> Iterator[Columns]:
    """The first ``rows`` rows of an open file, in pieces."""
    for first in range(0, rows, _COPY):
        count = min(_COPY, rows - first)
        piece = {}
        for name, array in columns.items():
            row = int(np.prod(array.shape[1:])) * array.dtype.itemsize
            file.seek(offsets[name] + first * row)
            piece[name] = np.frombuffer(file.read(count * row), array.dtype).reshape(count, *array.shape[1:])
        yield piece


def _reserve(handle: int, size: int) -> None:
    """Reserve the disk space before computing the rows."""
    if hasattr(os, "posix_fallocate"):
        try:
            os.posix_fallocate(handle, 0, size)
        except OSError as error:
            if error.errno not in (errno.EINVAL, errno.EOPNOTSUPP):  # some file systems cannot
                raise
