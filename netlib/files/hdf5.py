"""HDF5 files: opened only after a look at them from outside, and rows of data that are read without the library.

The HDF5 library may crash on a damaged file, or never return, and a file may lead to other files. So a helper process
looks at each file first (hdf5_helper.py).

Rows of data sets that are stored in one piece are then read by plain reads, neither by the library nor mapped into
memory: a file that is cut while it is in use is an error like any other, not the end of the process.
"""

from __future__ import annotations

import contextlib
import io
import math
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import DTypeLike

from netlib import files
from netlib.blob import Array
from netlib.errors import DataError, NetlibError, reason_of
from netlib.files import Source, atomic, hdf5_helper
from netlib.files.paths import exists, find

SMALL_ROW, IN_MEMORY = 4096, 1 << 26  # bytes: data sets of smaller rows are held in memory, if they are not larger


@contextlib.contextmanager
def opened(path: str | Path, what: str, kind: type[NetlibError] = DataError) -> Iterator[h5py.File]:
    """An HDF5 file, open for reading; ``what`` it is meant to be stands in the error.

    Raises ``kind``, also for whatever HDF5 raises within the block.
    """
    with files.opened(path, what, kind) as stream:
        looked_at = files.identity(stream.fileno())
    fault = hdf5_helper.fault_of(str(path), looked_at)
    if fault:
        raise kind(f"{path}: cannot read {what}: {fault}")
    try:
        with h5py.File(path, "r", locking=False) as file:
            if files.identity(file.id.get_vfd_handle()) != looked_at:  # another file took its place meanwhile
                raise kind(f"{path}: was changed while it was opened; run again")
            yield file
    except NetlibError:
        raise
    except (OSError, LookupError, TypeError, ValueError, RuntimeError, AttributeError, MemoryError) as error:
        raise kind(f"{path}: cannot read {what}: damaged, or not as expected: {reason_of(error)}") from error


@contextlib.contextmanager
def in_memory() -> Iterator[tuple[h5py.File, io.BytesIO]]:
    """A new file, and after the block its bytes, to be written by plain writes: one that fails within HDF5 may end the
    process."""
    image = io.BytesIO()
    with h5py.File(image, "w") as file:
        yield file, image


@contextlib.contextmanager
def written(path: Path) -> Iterator[h5py.File]:
    """A new HDF5 file that is written after the block, whole or not at all. Raises OSError."""
    with in_memory() as (file, image):
        yield file
    atomic.replace(path, lambda fresh: fresh.write_bytes(image.getvalue()))


def is_near(other: Path, path: Path) -> bool:
    """Is ``other`` a file below the folder of ``path``, beside that folder, or in one beside it? Links are followed.

    A file that somebody else made may name such files, and no private ones elsewhere.
    """
    file, folder = Path(os.path.realpath(other)), Path(os.path.realpath(path)).parent
    return file.is_relative_to(folder) or folder.parent in (file.parent, file.parent.parent)


class File:
    """Rows of some data sets of one HDF5 file.

    rows       in each data set
    datasets   one Rows for each of the names asked for
    names      of all that the file holds
    made_from  what the data are

    An attribute ``rest_in`` names another file, relative to the folder of the first, that has the data sets which the
    first lacks (``is_near``). (HDF5's own links into other files are not followed: the library would open whatever
    they name.)
    """

    def __init__(self, path: Path, names: tuple[str, ...]) -> None:
        self.path = path
        self.datasets: list[Rows] = []
        with contextlib.ExitStack() as stack:
            opens = [stack.enter_context(opened(path, "the HDF5 file"))]
            self.made_from = str(opens[0].attrs.get("made_from", "an unknown source"))
            self.sources = [self._source(path, opens[0])]
            if rest := opens[0].attrs.get("rest_in"):
                other = Path(os.path.normpath(path.parent / str(rest)))
                if Path(str(rest)).is_absolute() or not is_near(other, path):
                    raise DataError(f"{path}: rest_in is {str(rest)!r}; expected a relative name of a file in the same "
                                    "folder or in one beside it, and no link out of there")  # fmt: skip
                opens.append(stack.enter_context(opened(other, f"the rest of {path}")))
                self.sources.append(self._source(other, opens[1]))
            self.names = tuple(dict.fromkeys(name for file in opens for name in file))
            for name in names:
                for source, file in zip(self.sources, opens):
                    if isinstance(file.get(name), h5py.Dataset):
                        self.datasets.append(Rows(source, file[name]))
                        break
                else:
                    there = ", ".join(n for file in opens for n in file if isinstance(file.get(n), h5py.Dataset))
                    raise DataError(f"{path}: no data set {name!r}; it has {there or 'none'}")
        counts = {name: d.shape[0] if d.shape else 0 for name, d in zip(names, self.datasets)}
        if len(set(counts.values())) > 1:
            raise DataError(
                f"{path}: data sets of different length: {', '.join(f'{k} {v}' for k, v in counts.items())}"
            )
        self.rows = counts[names[0]]
        if self.rows == 0:
            raise DataError(f"{path}: data set {names[0]!r} has no rows")

    @staticmethod
    def _source(path: Path, file: h5py.File) -> Source:
        """For plain reads of the very file that is open. Raises DataError."""
        source = Source(path, "the HDF5 file")
        if not source.is_file(file.id.get_vfd_handle()):
            raise DataError(f"{path}: was changed while it was opened; run again")
        return source

    def check(self) -> None:
        """Raise DataError if a file has been changed since it was opened. One that takes its place does no harm."""
        for source in self.sources:
            source.check()


class Rows:
    """The rows of a data set, read when they are asked for, or held in memory.

    shape  (rows, ...)
    dtype  of the values in the file
    """

    def __init__(self, source: Source, dataset: h5py.Dataset) -> None:
        if dataset.dtype.kind not in "fiu":
            raise DataError(f"{source.path}: data set {dataset.name!r} holds {dataset.dtype}, expected numbers")
        self.shape: tuple[int, ...] = dataset.shape or ()
        self.dtype: np.dtype[Any] = dataset.dtype
        self._source, self._row = source, math.prod(self.shape[1:]) * self.dtype.itemsize
        self._offset: int | None = dataset.id.get_offset()
        small = self._row < SMALL_ROW and dataset.nbytes <= IN_MEMORY  # not worth a read for each
        other = dataset.id.get_type() != h5py.h5t.py_create(self.dtype)  # fewer bits: to be converted by the library
        held = self._offset is None or other or small or dataset.size == 0  # or in chunks, compressed
        self._held: Array | None = np.asarray(dataset[...]) if held else None

    def take(self, rows: Array, out: Array) -> None:
        """Copy some rows, by their numbers, into ``out``, converted to its type. Raises DataError."""
        if self._held is not None:
            out[...] = self._held[rows]
            return
        target = out if out.dtype == self.dtype and out.flags.c_contiguous else np.empty(out.shape, self.dtype)
        view = target.reshape(-1).view(np.uint8).data
        ends = [*(np.flatnonzero(np.diff(rows) != 1) + 1).tolist(), len(rows)]  # of rows that follow each other
        begin = 0
        for end in ends:
            at = self._offset + int(rows[begin]) * self._row
            self._source.read_into(view[begin * self._row : end * self._row], at)
            begin = end
        if target is not out:
            out[...] = target

    def __getitem__(self, rows: Any) -> Array:
        """A row by its number, or several by a slice or by their numbers."""
        numbers = np.arange(self.shape[0])[rows]
        out = np.empty((numbers.size, *self.shape[1:]), self.dtype)
        self.take(np.atleast_1d(numbers), out)
        return out.reshape(numbers.shape + self.shape[1:])

    def numbers(self) -> Array:
        """All rows, float64."""
        with np.errstate(all="ignore"):  # a damaged file may have numbers of any kind; who reads them looks at them
            return self[:].astype(np.float64)

    def __array__(self, dtype: DTypeLike | None = None, copy: bool | None = None) -> Array:
        """All rows."""
        return self[:].astype(dtype or self.dtype, copy=False)


def read_list(source: str, prototxt: str | None) -> list[Path]:
    """The files that a list names, relative to the working directory or to the list. Raises DataError."""
    path = find(source, prototxt)
    names = [line.strip() for line in files.read_text(path, "the list of HDF5 files").split("\n") if line.strip()]
    if not names:
        raise DataError(f"{source}: the list of HDF5 files is empty")
    found = []
    for name in names:
        found.append(find(name, str(path)))
        if not exists(found[-1]):
            raise DataError(f"{source}: names {name!r}, which does not exist; expected a path from the working "
                            "directory or from the list")  # fmt: skip
    return found
