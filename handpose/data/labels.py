"""Labels: where the joints are in the frames of an HDF5 file, and how many mm a unit of them is.

docs/data.md lists all that such a file holds. Whoever computes with labels, and not only trains on them, reads here

    joint      (n, 3 K) or (n, K, 3)  half-cubes from the crop centre; -1 or 1 where cut off at the cube, NaN if unknown
    half_cube  (n,) or (n, 1)         mm, more than 0; a file may do without
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from handpose.facts.nyu import CUBE_MM
from netlib.blob import Array
from netlib.errors import DataError
from netlib.hdf5 import File


@dataclass(frozen=True)
class Labels:
    """The labels of one file, in arrays of their own.

    joints     (n, K, 3) half-cubes from the crop centre
    half_cube  (n,) mm
    names      of all that the file holds
    made_from  what the data are
    """

    joints: Array
    half_cube: Array
    names: tuple[str, ...]
    made_from: str

    @property
    def seen(self) -> NDArray[np.bool_]:
        """(n, K): where each joint really is, not where it was cut off to."""
        return np.asarray((np.abs(self.joints) < 1).all(axis=2))


def read(path: Path, joint_counts: Collection[int], usual: float = CUBE_MM / 2) -> Labels:
    """The labels of a file. Raises DataError.

    joint_counts  how many joints there may be
    usual         half-cube in mm where the file does not say
    """
    file = File(path, ("joint",))
    stored = file.arrays[0]
    count = stored.size // file.rows // 3
    if count not in joint_counts or stored.shape[1:] not in ((3 * count,), (count, 3)):
        expected = " or ".join(f"(N, {3 * known}) for {known} joints" for known in joint_counts)
        raise DataError(f"{path}: data set 'joint' has shape {stored.shape}, expected {expected}")
    joints = stored.astype(np.float64).reshape(file.rows, count, 3)
    wrong = np.isinf(joints).any(axis=(1, 2))
    if wrong.any():
        raise DataError(f"{path}: data set 'joint' is infinite in frame {wrong.argmax()} ({wrong.sum()} such frames), "
                        "expected half-cubes from the crop centre, or NaN if unknown")  # fmt: skip
    return Labels(joints, read_half_cubes(file, usual), file.names, file.made_from)


def read_half_cubes(file: File, usual: float = CUBE_MM / 2) -> Array:
    """Half-cubes (n,) in mm of the frames of an open file, ``usual`` where it does not say. Raises DataError."""
    if "half_cube" not in file.names:
        return np.full(file.rows, usual)
    stored = File(file.path, ("half_cube",)).arrays[0]
    if stored.shape not in ((file.rows,), (file.rows, 1)):
        raise DataError(f"{file.path}: data set 'half_cube' has shape {stored.shape}, expected ({file.rows},): "
                        "mm, one number per frame")  # fmt: skip
    half_cube = stored.astype(np.float64).reshape(file.rows)
    wrong = ~(np.isfinite(half_cube) & (half_cube > 0))
    if wrong.any():
        first = wrong.argmax()
        raise DataError(f"{file.path}: data set 'half_cube' is {half_cube[first]:g} in frame {first} ({wrong.sum()} "
                        "such frames), expected mm, more than 0")  # fmt: skip
    return half_cube
