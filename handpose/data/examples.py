"""A few frames of any data set, spread evenly over it, to be looked at."""

from __future__ import annotations

from pathlib import Path

import h5py
import numpy as np
from numpy.typing import NDArray

from handpose.data.images import read_crop
from netlib.errors import DataError, reason_of
from netlib.hdf5 import read_list

# A crop (size, size) in [-1, 1], and the joints in half-cubes, if the data set has them.
Example = tuple[NDArray[np.float32], "NDArray[np.float64] | None"]


def examples_of(path: Path, count: int) -> list[Example]:
    """At most ``count`` frames of a list of HDF5 files, of one such file, or of a folder of crops. Raises DataError."""
    if path.is_dir():
        crops = sorted(p for p in path.iterdir() if p.suffix.lower() == ".png")
        if not crops:
            raise DataError(f"{path}: no PNG pictures in this folder; expected crops")
        return [(read_crop(crops[i]), None) for i in spread(len(crops), count)]
    files = [path] if path.suffix == ".h5" else read_list(str(path), None)
    try:
        rows = [(file, row) for file in files for row in range(_rows(file))]
        return [_example(*rows[i]) for i in spread(len(rows), count)]
    except OSError as error:
        raise DataError(f"{path}: cannot read the data: {reason_of(error)}") from None


def spread(total: int, count: int) -> NDArray[np.int_]:
    """At most ``count`` of ``total`` numbers from 0 on, spread evenly, the first and the last among them."""
    return np.linspace(0, total - 1, min(total, count)).astype(int)


def _rows(path: Path) -> int:
    with h5py.File(path, "r") as file:
        depth = file.get("depth")
        if not isinstance(depth, h5py.Dataset) or depth.ndim < 3 or depth.shape[-1] != depth.shape[-2]:
            raise DataError(f"{path}: no data set depth of square crops; it has {', '.join(file) or 'none'}")
        return len(depth)


def _example(path: Path, row: int) -> Example:
    with h5py.File(path, "r") as file:
        crop = np.asarray(file["depth"][row], dtype=np.float32)
        joints = np.asarray(file["joint"][row], dtype=np.float64) if "joint" in file else None
    return crop.reshape(crop.shape[-2:]), joints
