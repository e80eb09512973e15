"""A few frames of any data set, spread evenly over it, for display."""

from __future__ import annotations

import math
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from handpose.frames.images import read_crop
from netlib.errors import DataError
from netlib.files.hdf5 import File, read_list


class Example(NamedTuple):
    """One frame.

    crop    (size, size) in [-1, 1]
    joints  half-cubes, if the data set has them
    where   its file, and its row in it
    """

    crop: NDArray[np.float32]
    joints: NDArray[np.float64] | None
    where: str


def examples_of(path: Path, count: int) -> list[Example]:
    """At most ``count`` frames of a list of HDF5 files, of one such file, or of a folder of crops. Raises DataError."""
    if path.is_dir():
        crops = sorted(p for p in path.iterdir() if p.suffix.lower() == ".png")
        if not crops:
            raise DataError(f"{path}: no PNG pictures in this folder; expected crops")
        return [Example(read_crop(crops[i]), None, str(crops[i])) for i in spread(len(crops), count)]
    files = [path] if path.suffix == ".h5" else read_list(str(path), None)
    rows = [(file, row) for file in map(_open, files) for row in range(file.rows)]
    return [_example(*rows[i]) for i in spread(len(rows), count)]


def spread(total: int, count: int) -> NDArray[np.int_]:
    """At most ``count`` of ``total`` numbers from 0 on, spread evenly, the first and the last among them."""
    return np.linspace(0, total - 1, min(total, count)).astype(int)


def _open(path: Path) -> File:
    """A file of crops, with joints if it has them. Raises DataError."""
    file = File(path, ("depth",))
    shape = file.datasets[0].shape
    if len(shape) < 3 or shape[-1] != shape[-2] or math.prod(shape[1:]) != shape[-1] * shape[-2]:
        raise DataError(f"{path}: data set 'depth' has shape {shape}, expected square crops (N, 1, size, size)")
    return File(path, ("depth", "joint")) if "joint" in file.names else file


def _example(file: File, row: int) -> Example:
    crop, *joints = (dataset[row] for dataset in file.datasets)
    with np.errstate(all="ignore"):  # other number types; pixels that are not finite are drawn as missing
        depth = crop.reshape(crop.shape[-2:]).astype(np.float32)
        found = joints[0].astype(np.float64) if joints else None
    return Example(depth, found, f"{file.path}: frame {row}")
