"""HDF5Data: batches from HDF5 files.

top[i]  the rows of the data set of the same name, (batch_size, ...), converted to the net's type

``source`` is a list, one file a line. Rows are read in order, a batch runs on across the end of a file, and after
the last file it starts over. With ``shuffle`` every pass takes the files in a new order, and the rows of a file.

The order is a pure function of a *cursor* (pass, file, row) and the layer's seed. So a batch can be read ahead by a
thread while the net computes, and a cursor is all that a snapshot needs to go on with the very next row.
Data sets stored in one piece are mapped, not read: memory then holds only two batches, the one in the tops and the one
that is being read. They change places, so an array taken from a top is good until the next forward.
"""

from __future__ import annotations

import mmap
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from netlib.blob import Array, Blobs
from netlib.errors import DataError, reason_of
from netlib.layer import Layer
from netlib.paths import exists, find
from netlib.schema import UInt

Cursor = tuple[int, int, int]  # pass over the files, place in the order of files, place in the order of rows


@dataclass(frozen=True)
class HDF5DataParameter:
    """The ``hdf5_data_param { ... }`` block."""

    source: str  # the list of files
    batch_size: UInt
    shuffle: bool = False


class HDF5Data(Layer):
    """Reads batches, one ahead."""

    param_type = HDF5DataParameter
    param_name = "hdf5_data_param"
    bottoms = (0, 0)
    tops = (1, None)

    def setup(self, bottom: Blobs, top: Blobs) -> None:
        if self.param.batch_size == 0:
            raise self.fail("batch_size must be at least 1", "batch_size")
        self.seed = int(self.rng.integers(2**62))
        self.files = [File(path, self.spec.top) for path in read_list(self.param.source, self.source)]
        self.rows = sum(file.rows for file in self.files)
        for file in self.files[1:]:
            for name, first, this in zip(self.spec.top, self.files[0].arrays, file.arrays):
                if first.shape[1:] != this.shape[1:]:
                    raise DataError(f"{file.path}: rows of {name!r} have shape {this.shape[1:]}, "
                                    f"those in {self.files[0].path} {first.shape[1:]}")  # fmt: skip
        if self.param.batch_size > self.rows:
            self.notes = [f"warning: batch_size {self.param.batch_size} is more than the {self.rows} rows of "
                          f"{self.param.source}; every batch repeats some"]  # fmt: skip
        else:
            self.notes = []
        self.notes += [
            f"{self.rows} rows in {len(self.files)} files of {self.param.source}, made from {self._origin()}"
        ]
        self.cursor: Cursor = (0, 0, 0)
        self._ahead: Future[Cursor] | None = None
        self.use_batch_size(self.param.batch_size)
        self._reader = ThreadPoolExecutor(1, "hdf5_data")

    def _origin(self) -> str:
        return ", ".join(sorted({file.made_from for file in self.files}))

    def reshape(self, bottom: Blobs, top: Blobs) -> None:
        for blob, array in zip(top, self.files[0].arrays):
            blob.reshape(self.batch_size, *array.shape[1:])

    def forward(self, bottom: Blobs, top: Blobs) -> None:
        ahead = self._ahead or self._reader.submit(self.read, self.cursor, self._next)
        self._ahead = None  # if it failed, the next forward tries again
        self.cursor = ahead.result()
        for i, blob in enumerate(top):
            read, used = self._next[i], blob.data
            blob.adopt(read)
            self._next[i] = used
        self._ahead = self._reader.submit(self.read, self.cursor, self._next)

    def state(self) -> dict[str, Any]:
        return {"seed": self.seed, "cursor": list(self.cursor), "files": self._identity()}

    def restore(self, state: dict[str, Any]) -> None:
        if "seed" not in state:  # of a layer of another type
            return
        self._drop_ahead()
        self.seed = int(state["seed"])
        if state.get("files") == self._identity():  # with other data there is no such place to go on
            self.cursor = (int(state["cursor"][0]), int(state["cursor"][1]), int(state["cursor"][2]))

    def _identity(self) -> list[list[Any]]:
        return [[file.path.name, file.rows, file.made_from] for file in self.files]

    def use_batch_size(self, size: int) -> None:
        """Read ``size`` rows at a time from now on; the net must be reshaped after it."""
        self._drop_ahead()
        self.batch_size = size
        self._next = [np.empty((size, *a.shape[1:]), self.dtype) for a in self.files[0].arrays]

    def rewind(self) -> None:
        """Go on from the first row."""
        self._drop_ahead()
        self.cursor = (0, 0, 0)

    def _drop_ahead(self) -> None:
        if self._ahead is not None:
            self._ahead.exception()  # waits; nobody wants the batch, or to know why it could not be read
            self._ahead = None

    def row(self, number: int) -> list[Array]:
        """One row of every data set, counted over all files in the order of the list."""
        for file in self.files:
            if number < file.rows:
                file.check_size()
                return [np.asarray(array[number]) for array in file.arrays]
            number -= file.rows
        raise IndexError(f"there are {self.rows} rows")

    # ------------------------------------------------------------------------------------------ the order of rows

    def read(self, cursor: Cursor, batch: list[Array]) -> Cursor:
        """Fill ``batch`` with the rows from ``cursor`` on; returns the cursor after them."""
        done, size = 0, len(batch[0])
        while done < size:
            turn, place, row = cursor
            file = self.files[self._order(len(self.files), turn, 0)[place]]
            take = min(size - done, file.rows - row)
            rows = self._order(file.rows, turn, 1 + place)[row : row + take] if self.param.shuffle else None
            file.check_size()
            for out, array in zip(batch, file.arrays):
                target = out[done : done + take]
                if rows is None:
                    target[...] = array[row : row + take]
                elif array.dtype == target.dtype:
                    np.take(array, rows, axis=0, out=target, mode="clip")
                else:
                    target[...] = array[rows]
            done += take
            cursor = (turn, place, row + take)
            if row + take == file.rows:
                cursor = (turn, place + 1, 0) if place + 1 < len(self.files) else (turn + 1, 0, 0)
        return cursor

    def _order(self, count: int, turn: int, stream: int) -> Array:
        if not self.param.shuffle or count == 1:
            return np.arange(count)
        return np.random.default_rng([self.seed, turn, stream]).permutation(count)


class File:
    """One open HDF5 file: an array for each data set, mapped if it is stored in one piece.

    arrays     one for each of the names asked for
    rows       in each array
    names      of all that the file holds
    made_from  what the data are

    Before reading from ``arrays`` of a file that has been open for a while, ``check_size``.
    """

    def __init__(self, path: Path, names: tuple[str, ...]) -> None:
        self.path = path
        self._maps: dict[str, mmap.mmap] = {}  # by the name of the file, which links may lead out of this one
        try:
            path.open("rb").close()
            with h5py.File(path, "r") as file:
                for name in names:
                    link = file.get(name, getlink=True)
                    if isinstance(link, h5py.ExternalLink) and file.get(name) is None:
                        raise DataError(
                            f"{path}: data set {name!r} is kept in {link.filename}, which is missing or lacks it"
                        )
                    if not isinstance(file.get(name), h5py.Dataset):
                        there = ", ".join(n for n in file if isinstance(file.get(n), h5py.Dataset)) or "none"
                        raise DataError(f"{path}: no data set {name!r}; it has {there}")
                self.arrays = [self._array(file[name]) for name in names]
                self.names = tuple(file)
                self.made_from = str(file.attrs.get("made_from", "an unknown source"))
        except (OSError, ValueError, RuntimeError) as error:
            raise DataError(f"{path}: cannot read the HDF5 file: {reason_of(error)}") from error
        counts = {name: a.shape[0] if a.ndim else 0 for name, a in zip(names, self.arrays)}
        if len(set(counts.values())) > 1:
            raise DataError(
                f"{path}: data sets of different length: {', '.join(f'{k} {v}' for k, v in counts.items())}"
            )
        self.rows = counts[names[0]]
        if self.rows == 0:
            raise DataError(f"{path}: data set {names[0]!r} has no rows")

    def _array(self, dataset: h5py.Dataset) -> Array:
        if dataset.dtype.kind not in "fiu":
            raise DataError(f"{self.path}: data set {dataset.name!r} holds {dataset.dtype}, expected numbers")
        offset = dataset.id.get_offset()
        if offset is None or dataset.size == 0:  # in chunks, compressed, in a raw file elsewhere, or empty
            return np.asarray(dataset[...])
        home = dataset.file.filename  # another file for an external link
        if home not in self._maps:
            with open(home, "rb") as stream:
                self._maps[home] = mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ)
        return np.frombuffer(self._maps[home], dataset.dtype, dataset.size, offset).reshape(dataset.shape)

    def check_size(self) -> None:
        """Raise DataError if a mapped file has been cut: to read what is gone would kill the process.

        That still happens if the file is cut while it is read. A file that takes another's place does no harm.
        """
        for home, mapped in self._maps.items():
            size = mapped.size()
            if size < len(mapped):
                raise DataError(f"{home}: was cut to {size} bytes while in use, expected {len(mapped)}; "
                                "restore the file and run again")  # fmt: skip


def read_list(source: str, prototxt: str | None) -> list[Path]:
    """The files that a list names, relative to the working directory or to the list. Raises DataError."""
    path = find(source, prototxt)
    try:
        lines = path.read_text(encoding="utf-8-sig").split("\n")
    except (OSError, ValueError) as error:
        raise DataError(f"{source}: cannot read the list of HDF5 files: {reason_of(error)}") from error
    names = [line.strip() for line in lines if line.strip()]
    if not names:
        raise DataError(f"{source}: the list of HDF5 files is empty")
    files = []
    for name in names:
        files.append(find(name, str(path)))
        if not exists(files[-1]):
            raise DataError(f"{source}: names {name!r}, which does not exist; expected a path from the working "
                            "directory or from the list")  # fmt: skip
    return files
