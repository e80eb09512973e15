"""HDF5Data: batches from HDF5 files.

top[i]  rows of the data set with the name of the top, (batch_size, ...), converted to
        the net's dtype

``source`` is a list, one file per line. Rows are read in order; batches continue across files and
start over after the last one. With ``shuffle``, every pass visits the files, and the rows of each
file, in a new order.

The order is a pure function of a *cursor* (pass, file, row) and the layer's seed, so the cursor is
all that a snapshot needs to continue with the next row.
"""

from __future__ import annotations

import zlib
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from layers.data.reader import Reader
from netlib.blob import Array, Blobs
from netlib.errors import DataError
from netlib.files.hdf5 import File, read_list
from netlib.layer import warn
from netlib.proto.schema import UInt, numbered

# number of the pass, index in the order of files, index in the order of rows
Cursor = tuple[int, int, int]


@dataclass(frozen=True)
class HDF5DataParameter:
    """The ``hdf5_data_param { ... }`` block."""

    source: str = numbered(1)  # path of the list of files
    batch_size: UInt = numbered(2)
    shuffle: bool = numbered(3, False)


class HDF5Data(Reader):
    """Reads batches.

    files   the open files
    rows    total number of rows
    cursor  start of the next batch
    notes   lines for the log
    """

    param: HDF5DataParameter
    param_name = "hdf5_data_param"
    rejected_blocks: ClassVar[dict[str, str]] = {
        "transform_param": "HDF5Data does not transform data, as in Caffe; write transformed values to the files"
    }
    bottoms = (0, 0)
    tops = (1, None)

    def setup(self, bottom: Blobs, top: Blobs) -> None:
        source = self.param.source
        self.batch_size = self.batch_of()
        self.seed = int(self.rng.integers(2**62))
        self.cursor: Cursor = (0, 0, 0)
        self.files = [File(path, self.spec.top) for path in read_list(source, self.source)]
        self.rows = sum(file.rows for file in self.files)
        first = self.files[0]
        for file in self.files[1:]:
            for name, expected, found in zip(self.spec.top, first.datasets, file.datasets):
                if expected.shape[1:] != found.shape[1:]:
                    raise DataError(
                        f"{file.path}: rows of {name!r} have shape {found.shape[1:]}, "
                        f"those in {first.path} {expected.shape[1:]}"
                    )
        origin = ", ".join(sorted({file.made_from for file in self.files}))
        self.notes = [
            f"{self.rows} rows in {len(self.files)} files of {source}, made from {origin}"
        ]
        step = self.batch_size * self.shard.count
        if step > self.rows:
            warn(
                self,
                f"batch_size {step} is more than the {self.rows} rows of {source}; every batch repeats some",
            )

    def reshape(self, bottom: Blobs, top: Blobs) -> None:
        for blob, dataset in zip(top, self.files[0].datasets):
            blob.reshape(self.batch_size, *dataset.shape[1:])

    def forward(self, bottom: Blobs, top: Blobs) -> None:
        self.cursor = self.read(self.cursor, [blob.data for blob in top])

    def read(self, cursor: Cursor, batch: list[Array]) -> Cursor:
        """Fill ``batch`` with the rows from ``cursor`` on, or with this rank's shard of them;
        returns the cursor after them.
        """
        done, size = 0, len(batch[0]) * self.shard.count
        while done < size:
            turn, place, row = cursor
            file = self._file(turn, place)
            take = min(size - done, file.rows - row)
            rows = self.order(file.rows, turn, 1 + place)[row : row + take]
            file.check()
            own, places = self.shard.rows(done, take)
            for out, dataset in zip(batch, file.datasets):
                dataset.take(rows[own], out[places])
            done += take
            cursor = (turn, place, row + take)
            if row + take == file.rows:
                is_last = place + 1 == len(self.files)
                cursor = (turn + 1, 0, 0) if is_last else (turn, place + 1, 0)
        return cursor

    def _file(self, turn: int, place: int) -> File:
        """The file that a pass visits in this place."""
        return self.files[self.order(len(self.files), turn, 0)[place]]

    def order(self, count: int, turn: int, stream: int) -> Array:
        """Order in which a pass visits the files (stream 0), or the rows of its n-th
        file (stream n).
        """
        if not self.param.shuffle or count == 1:
            return np.arange(count)
        return np.random.default_rng([self.seed, turn, stream]).permutation(count)

    # ------------------------------------------------------------------------- for resume and tools

    def state(self) -> dict[str, Any]:
        return {"seed": self.seed, "cursor": list(self.cursor), "files": self._identity()}

    def restore(self, state: dict[str, Any]) -> None:
        if "seed" not in state:  # state of a layer of another type
            return
        self.seed = int(state["seed"])
        if state.get("files") == self._identity():  # otherwise the position is meaningless
            turn, place, row = map(int, state["cursor"])
            self.cursor = (turn, place, row)
            if turn < 0 or not 0 <= row < self._file(turn, place).rows or place < 0:
                raise ValueError(f"there is no row at {state['cursor']}")

    def reads(self) -> Any:
        """Identity of the files, with a checksum of the last row of each."""
        last = [b"".join(x[file.rows - 1].tobytes() for x in file.datasets) for file in self.files]
        return [[*identity, zlib.crc32(row)] for identity, row in zip(self._identity(), last)]

    def _identity(self) -> list[list[Any]]:
        return [[file.path.name, file.rows, file.made_from] for file in self.files]

    def use_batch_size(self, size: int) -> None:
        """Read ``size`` rows at a time from now on. The net must be reshaped afterwards."""
        self.batch_size = size

    def rewind(self) -> None:
        """Continue with the first row."""
        self.cursor = (0, 0, 0)

    def row(self, number: int) -> list[Array]:
        """One row of every data set, numbered over all files in the order of the list."""
        for file in self.files:
            if number < file.rows:
                file.check()
                return [dataset[number] for dataset in file.datasets]
            number -= file.rows
        raise IndexError(f"there are {self.rows} rows")
