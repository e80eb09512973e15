"""HDF5 files: checked by a helper process before they are opened, and rows read without the HDF5 library.

The HDF5 library can crash or hang on a damaged file, and a file can refer to other files. A helper process therefore
checks each file first (hdf5_helper.py).

Rows of contiguous data sets are then read with plain reads, not through the library or by memory mapping, so a file
that is truncated while in use causes an ordinary error instead of a crash.
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
from netlib.errors import DataError, NetlibError, reason_of, system_error_of
from netlib.files import Content, Identity, Source, atomic, hdf5_helper
from netlib.files.paths import exists, find

SMALL_ROW, IN_MEMORY = 4096, 1 << 26  # bytes: data sets with smaller rows, up to this size, are kept in memory


@contextlib.contextmanager
def opened(path: str | Path | Content, what: str, kind: type[NetlibError] = DataError) -> Iterator[h5py.File]:
    """Open an HDF5 file, or content read before, for reading; ``what`` describes its expected content in errors.

    Raises ``kind``, including for errors of HDF5 inside the ``with`` block.
    """
    content = path if isinstance(path, Content) else None
    looked_at = content.identity if content else _identity(path, what, kind)
    fault = hdf5_helper.fault_of(str(path), looked_at)
    if fault:
        raise kind(f"{path}: cannot read {what}: {fault}")
    try:
        with h5py.File(io.BytesIO(content.data) if content else path, "r", locking=False) as file:
            now = _identity(content.path, what, kind) if content else files.identity(file.id.get_vfd_handle())
            if now != looked_at:  # another file was renamed to this path
                raise kind(f"{path}: was changed while it was opened; run again")
            yield file
    except NetlibError:
        raise
    except (OSError, LookupError, TypeError, ValueError, RuntimeError, AttributeError, MemoryError) as error:
        why = "" if system_error_of(error) else "damaged, or not as expected: "
        raise kind(f"{path}: cannot read {what}: {why}{reason_of(error)}") from error


def _identity(path: str | Path | Content, what: str, kind: type[NetlibError]) -> Identity:
    with files.opened(str(path), what, kind) as stream:
        return files.identity(stream.fileno())


def members(group: h5py.Group | h5py.AttributeManager) -> list[tuple[str, Any]]:
    """The names and members of a group or of attributes.

    h5py's own ``items()`` and ``values()`` hold the lock of the library between two members, so that other threads
    wait; for ever, if a loop that was left is collected by another thread.
    """
    return [(name, group.get(name)) for name in group]


@contextlib.contextmanager
def in_memory() -> Iterator[tuple[h5py.File, io.BytesIO]]:
    """Yield a new file and the stream that holds its bytes after the block. The caller writes them with plain writes,
    because a write that fails inside HDF5 can crash the process."""
    image = io.BytesIO()
    with h5py.File(image, "w") as file:
        yield file, image


@contextlib.contextmanager
def created(path: Path) -> Iterator[h5py.File]:
    """Yield a new HDF5 file, which is written atomically after the block. Raises OSError."""
    with in_memory() as (file, image):
        yield file
    atomic.replace(path, lambda fresh: fresh.write_bytes(image.getvalue()))


def is_near(other: Path, path: Path) -> bool:
    """Whether ``other`` is below the folder of ``path``, next to that folder, or in a folder next to it.

    Links are followed. A file from an untrusted source may name only such files, not private ones elsewhere.
    """
    file, folder = Path(os.path.realpath(other)), Path(os.path.realpath(path)).parent
    return file.is_relative_to(folder) or folder.parent in (file.parent, file.parent.parent)


class File:
    """Rows of some data sets of one HDF5 file.

    rows       number of rows of each data set
    datasets   one Rows for each requested name
    names      all names in the file
    made_from  origin of the data

    The attribute ``rest_in`` names another file, relative to the folder of the first, with the data sets that the first
    lacks (``is_near``). HDF5's own external links are not followed, because the library would open any file that they
    name.
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
                                    "folder or in one next to it, and no link to elsewhere")
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
        """Open the same file for plain reads. Raises DataError."""
        source = Source(path, "the HDF5 file")
        if not source.is_file(file.id.get_vfd_handle()):
            raise DataError(f"{path}: was changed while it was opened; run again")
        return source

    def check(self) -> None:
        """Raise DataError if a file was changed since it was opened. Replacing it by renaming is harmless."""
        for source in self.sources:
            source.check()


class Rows:
    """The rows of a data set, read on access or kept in memory.

    shape  (rows, ...)
    dtype  dtype of the values in the file
    """

    def __init__(self, source: Source, dataset: h5py.Dataset) -> None:
        if dataset.dtype.kind not in "fiu":
            raise DataError(f"{source.path}: data set {dataset.name!r} holds {dataset.dtype}, expected numbers")
        self.shape: tuple[int, ...] = dataset.shape or ()
        self.dtype: np.dtype[Any] = dataset.dtype
        self._source, self._row = source, math.prod(self.shape[1:]) * self.dtype.itemsize
        self._offset: int | None = dataset.id.get_offset()
        small = self._row < SMALL_ROW and dataset.nbytes <= IN_MEMORY  # too small for a read per row
        other = dataset.id.get_type() != h5py.h5t.py_create(self.dtype)  # a packed type, which the library converts
        held = self._offset is None or other or small or dataset.size == 0  # no offset: chunked or compressed
        self._held: Array | None = np.asarray(dataset[...]) if held else None

    def take(self, rows: Array, out: Array) -> None:
        """Copy the rows with these numbers into ``out``, converting to its dtype. Raises DataError."""
        if self._held is not None:
            out[...] = self._held[rows]
            return
        target = out if out.dtype == self.dtype and out.flags.c_contiguous else np.empty(out.shape, self.dtype)
        view = target.reshape(-1).view(np.uint8).data
        ends = [*(np.flatnonzero(np.diff(rows) != 1) + 1).tolist(), len(rows)]  # ends of runs of consecutive rows
        begin = 0
        for end in ends:
            at = self._offset + int(rows[begin]) * self._row
            self._source.read_into(view[begin * self._row : end * self._row], at)
            begin = end
        if target is not out:
            out[...] = target

    def __getitem__(self, rows: Any) -> Array:
        """Return a row by number, or several by a slice or an array of numbers."""
        numbers = np.arange(self.shape[0])[rows]
        out = np.empty((numbers.size, *self.shape[1:]), self.dtype)
        self.take(np.atleast_1d(numbers), out)
        return out.reshape(numbers.shape + self.shape[1:])

    def numbers(self) -> Array:
        """All rows as float64."""
        with np.errstate(all="ignore"):  # a damaged file may hold any numbers; the caller checks them
            return self[:].astype(np.float64)

    def __array__(self, dtype: DTypeLike | None = None, copy: bool | None = None) -> Array:
        """All rows."""
        return self[:].astype(dtype or self.dtype, copy=False)


def read_list(source: str, prototxt: str | None) -> list[Path]:
    """Files named in a list, relative to the working directory or to the list. Raises DataError."""
    path = find(source, prototxt)
    names = [line.strip() for line in files.read_text(path, "the list of HDF5 files").split("\n") if line.strip()]
    if not names:
        raise DataError(f"{source}: the list of HDF5 files is empty")
    found = []
    for name in names:
        found.append(find(name, str(path)))
        if not exists(found[-1]):
            raise DataError(f"{source}: names {name!r}, which does not exist; expected a path relative to the working "
                            "directory or to the list")
    return found
