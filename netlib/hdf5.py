"""Data in HDF5 files: rows of arrays, and the lists that name files.

Data sets stored in one piece are mapped, not read, so a file may be larger than the memory.
"""

from __future__ import annotations

import mmap
from pathlib import Path

import h5py
import numpy as np

from netlib.blob import Array
from netlib.errors import DataError, NetlibError, reason_of
from netlib.paths import exists, find


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
        except NetlibError:
            raise
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
        if fault := storage_fault(dataset):
            raise DataError(f"{self.path}: data set {dataset.name!r} {fault}; expected data")
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


def storage_fault(dataset: h5py.Dataset) -> str:
    """What is wrong with a data set that claims far more values than its file holds; empty if nothing.

    HDF5 makes up values that were never written, so a small file could fill the memory. No compression that HDF5 has
    by itself makes data a thousand times smaller.
    """
    stored = dataset.id.get_storage_size()
    if dataset.nbytes < 1 << 26 or dataset.nbytes <= 2000 * stored or dataset.is_virtual or dataset.external:
        return ""
    return f"claims {dataset.nbytes} bytes, but only {stored} are stored"


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
