"""HDF5 files: opened with checks, and rows read without the HDF5 library.

The HDF5 library can crash on a damaged file. A snapshot of this project therefore ends with a
checksum of its bytes (``sealed``), which is compared before the library opens it; other programs
ignore what follows the end of the file's content. A damaged file without it can crash or stall the
library. In every file, what refers outside the file is refused.

Rows of contiguous data sets are read with plain reads, not through the library or by memory
mapping, so a file that is truncated while in use causes an ordinary error instead of a crash.
"""

from __future__ import annotations

import contextlib
import io
import math
import os
import re
import zlib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import DTypeLike

from netlib import files
from netlib.blob import Array
from netlib.errors import DataError, NetlibError, reason_of, system_error_of
from netlib.files import Content, Source, atomic
from netlib.files.paths import exists, find, real
from netlib.system import memory

# bytes: data sets with smaller rows, up to this size, are kept in memory
SMALL_ROW, IN_MEMORY = 4096, 1 << 26
# data sets of at least this many bytes must be stored, up to twice gzip's largest ratio
LARGE, MAX_RATIO = 1 << 26, 2000
SEAL = re.compile(rb"\nnetlib:crc32=([0-9a-f]{8})\n")
SEAL_BYTES = len(b"\nnetlib:crc32=01234567\n")


@contextlib.contextmanager
def opened(
    path: str | Path | Content, what: str, kind: type[NetlibError] = DataError
) -> Iterator[h5py.File]:
    """Open an HDF5 file, or content read before, for reading; ``what`` describes its expected
    content in errors.

    Raises ``kind``, including for errors of HDF5 inside the ``with`` block.
    """

    def refused(why: str) -> NetlibError:
        return kind(f"{path}: cannot read {what}: {why}")

    def failure(error: Exception, otherwise: str) -> NetlibError:
        return refused(f"{'' if system_error_of(error) else otherwise}{reason_of(error)}")

    path = _checked(path, what, kind)
    place = io.BytesIO(path.data) if isinstance(path, Content) else path
    try:
        file = h5py.File(place, "r", locking=False)
    except (OSError, RuntimeError) as error:
        raise failure(error, "damaged or truncated: ") from error
    try:
        with file:
            _check_objects(file, refused)
            yield file
    except NetlibError:
        raise
    except (
        OSError,
        LookupError,
        TypeError,
        ValueError,
        RuntimeError,
        AttributeError,
        MemoryError,
    ) as error:
        raise failure(error, "damaged, or not as expected: ") from error


def sealed(image: bytes) -> bytes:
    """The content of an HDF5 file, followed by its checksum."""
    return image + b"\nnetlib:crc32=%08x\n" % zlib.crc32(image)


def _checked(
    path: str | Path | Content, what: str, kind: type[NetlibError]
) -> str | Path | Content:
    """The content of a file that ends with a checksum, or the path of one without.

    Raises ``kind`` if the checksum differs.
    """
    if not isinstance(path, Content):
        with files.opened(path, what, kind) as stream:
            stream.seek(max(0, stream.seek(0, os.SEEK_END) - SEAL_BYTES))
            if not SEAL.fullmatch(stream.read()):
                return path
        path = Content(Path(path), files.read_bytes(path, what, kind, memory.physical()))
    seal = SEAL.fullmatch(path.data[-SEAL_BYTES:])
    if seal and int(seal[1], 16) != zlib.crc32(memoryview(path.data)[:-SEAL_BYTES]):
        raise kind(f"{path}: cannot read {what}: damaged: checksum mismatch")
    return path


def _check_objects(file: h5py.File, refused: Callable[[str], NetlibError]) -> None:
    """Raise the error ``refused`` for what refers to other files, and for data sets whose values
    are not stored.
    """
    seen: set[int] = set()
    waiting: list[h5py.Group] = [file]
    while waiting:
        group = waiting.pop()
        for name in group:
            link = group.get(name, getlink=True)
            if isinstance(link, h5py.ExternalLink):
                where = f"{group.name.rstrip('/')}/{name}"
                raise refused(
                    f"{where!r} is a link into another file, {link.filename!r}, which is not followed; "
                    "expected all in one file"
                )
            if isinstance(link, h5py.SoftLink):  # its target is checked where it is stored
                continue
            item = group[name]
            address = h5py.h5o.get_info(item.id).addr
            if address in seen:
                continue
            seen.add(address)
            if isinstance(item, h5py.Group):
                waiting.append(item)
            elif isinstance(item, h5py.Dataset):
                _check_dataset(item, refused)


def _check_dataset(dataset: h5py.Dataset, refused: Callable[[str], NetlibError]) -> None:
    where = f"data set {dataset.name!r}"
    if dataset.is_virtual:
        raise refused(
            f"{where} is virtual and refers to other data sets, which are not read; expected values"
        )
    if dataset.external:
        raise refused(
            f"{where} is kept in another file, {dataset.external[0][0]!r}, which is not read; "
            "expected all in one file"
        )
    stored = dataset.id.get_storage_size()
    claimed = math.prod(dataset.shape or ()) * dataset.id.get_type().get_size()
    is_contiguous = dataset.id.get_offset() is not None
    is_too_large = claimed >= LARGE and claimed > MAX_RATIO * stored
    if claimed > stored and (is_contiguous or is_too_large):
        raise refused(
            f"{where} claims {claimed} bytes, but only {stored} are stored; expected data"
        )


@contextlib.contextmanager
def in_memory() -> Iterator[tuple[h5py.File, io.BytesIO]]:
    """Yield a new file and the stream that holds its bytes after the block.

    The caller writes them with plain writes, because a write that fails inside HDF5 can
    crash the process.
    """
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
    """Whether ``other`` is below the folder of ``path``, next to that folder, or in a
    folder next to it.

    Links are followed. A file from an untrusted source may name only such files, not private
    ones elsewhere.
    """
    file = real(other)
    folder = real(path).parent
    return file.is_relative_to(folder) or folder.parent in (file.parent, file.parent.parent)


def _rest_of(path: Path, rest: str) -> Path:
    """The file that the attribute ``rest_in`` of a file names.

    Raises DataError if it is not near that file.
    """
    other = Path(os.path.normpath(path.parent / rest))
    if Path(rest).is_absolute() or not is_near(other, path):
        raise DataError(
            f"{path}: rest_in is {rest!r}; expected a relative name of a file in the same "
            "folder or in one next to it, and no link to elsewhere"
        )
    return other


class File:
    """Rows of some data sets of one HDF5 file.

    rows       number of rows of each data set
    datasets   one Rows for each requested name
    names      all names in the file
    made_from  origin of the data

    The attribute ``rest_in`` names another file, relative to the folder of the first, with the data
    sets that the first lacks (``is_near``). HDF5's own external links are not followed, because the
    library would open any file that they name.
    """

    def __init__(self, path: Path, names: tuple[str, ...]) -> None:
        self.path = path
        with contextlib.ExitStack() as stack:
            opens = [stack.enter_context(opened(path, "the HDF5 file"))]
            self.made_from = str(opens[0].attrs.get("made_from", "an unknown source"))
            self.sources = [Source(path, "the HDF5 file")]
            if rest := opens[0].attrs.get("rest_in"):
                other = _rest_of(path, str(rest))
                opens.append(stack.enter_context(opened(other, f"the rest of {path}")))
                self.sources.append(Source(other, "the HDF5 file"))
            self.names = tuple(dict.fromkeys(name for file in opens for name in file))
            self.datasets = [self._rows(name, opens) for name in names]
        counts = {
            name: rows.shape[0] if rows.shape else 0 for name, rows in zip(names, self.datasets)
        }
        if len(set(counts.values())) > 1:
            raise DataError(
                f"{path}: data sets of different length: {', '.join(f'{k} {v}' for k, v in counts.items())}"
            )
        self.rows = counts[names[0]]
        if self.rows == 0:
            raise DataError(f"{path}: data set {names[0]!r} has no rows")

    def _rows(self, name: str, opens: list[h5py.File]) -> Rows:
        """The rows of a data set of the first file that has it. Raises DataError if none does."""
        for source, file in zip(self.sources, opens):
            if isinstance(file.get(name), h5py.Dataset):
                return Rows(source, file[name])
        there = [n for file in opens for n in file if isinstance(file.get(n), h5py.Dataset)]
        raise DataError(f"{self.path}: no data set {name!r}; it has {', '.join(there) or 'none'}")

    def check(self) -> None:
        """Raise DataError if a file was changed since it was opened.

        Replacing it by renaming is harmless.
        """
        for source in self.sources:
            source.check()


class Rows:
    """The rows of a data set, read on access or kept in memory.

    shape  (rows, ...)
    dtype  dtype of the values in the file
    """

    def __init__(self, source: Source, dataset: h5py.Dataset) -> None:
        if dataset.dtype.kind not in "fiu":
            raise DataError(
                f"{source.path}: data set {dataset.name!r} holds {dataset.dtype}, expected numbers"
            )
        self.shape: tuple[int, ...] = dataset.shape or ()
        self.dtype: np.dtype[Any] = dataset.dtype
        self._source = source
        self._row = math.prod(self.shape[1:]) * self.dtype.itemsize  # bytes of a row
        self._offset: int | None = dataset.id.get_offset()  # None: chunked or compressed
        is_small = self._row < SMALL_ROW and dataset.nbytes <= IN_MEMORY
        is_converted = dataset.id.get_type() != h5py.h5t.py_create(self.dtype)  # from packed bits
        is_held = self._offset is None or is_converted or is_small or dataset.size == 0
        self._held: Array | None = np.asarray(dataset[...]) if is_held else None

    def take(self, rows: Array, out: Array) -> None:
        """Copy the rows with these numbers, which must exist, into ``out``, in its dtype.

        Raises DataError.
        """
        if self._held is not None:
            if out.dtype == self.dtype:
                # with another mode NumPy copies twice, in case of an error
                np.take(self._held, rows, axis=0, out=out, mode="clip")
            else:
                out[...] = self._held[rows]
            return
        is_direct = out.dtype == self.dtype and out.flags.c_contiguous
        target = out if is_direct else np.empty(out.shape, self.dtype)
        self._read(rows, target.reshape(-1).view(np.uint8).data)
        if not is_direct:
            out[...] = target

    def _read(self, rows: Array, target: memoryview) -> None:
        """Read the bytes of rows into ``target``, each run of consecutive rows at once."""
        first_of_runs = np.flatnonzero(np.diff(rows) != 1) + 1
        begin = 0
        for end in [*first_of_runs.tolist(), len(rows)]:
            offset = self._offset + int(rows[begin]) * self._row
            self._source.read_into(target[begin * self._row : end * self._row], offset)
            begin = end

    def __getitem__(self, rows: Any) -> Array:
        """Return a row by number, or several by a slice or an array of numbers."""
        numbers = np.arange(self.shape[0])[rows]
        out = np.empty((numbers.size, *self.shape[1:]), self.dtype)
        self.take(np.atleast_1d(numbers), out)
        return out.reshape(numbers.shape + self.shape[1:])

    def numbers(self) -> Array:
        """All rows as float64."""
        # a damaged file may hold any numbers; the caller checks them
        with np.errstate(all="ignore"):
            return self[:].astype(np.float64)

    def __array__(self, dtype: DTypeLike | None = None, copy: bool | None = None) -> Array:
        """All rows."""
        return self[:].astype(dtype or self.dtype, copy=False)


def read_list(source: str, prototxt: str | None) -> list[Path]:
    """Files named in a list, relative to the working directory or to the list. Raises DataError."""
    path = find(source, prototxt)
    names = [
        line.strip()
        for line in files.read_text(path, "the list of HDF5 files").split("\n")
        if line.strip()
    ]
    if not names:
        raise DataError(f"{source}: the list of HDF5 files is empty")
    found = []
    for name in names:
        found.append(find(name, str(path)))
        if not exists(found[-1]):
            raise DataError(
                f"{source}: names {name!r}, which does not exist; expected a path relative to the working "
                "directory or to the list"
            )
    return found
