"""HDF5 files of given arrays."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import ArrayLike


def write_hdf5(path: Path, **datasets: Any) -> Path:
    """Write a file of data sets; returns its path."""
    with h5py.File(path, "w") as file:
        for name, values in datasets.items():
            file[name] = values
    return path


def write_joints(path: Path, joints: ArrayLike, **more: Any) -> Path:
    """Write a file of joints (N, K, 3) as (N, 3 K), and other data sets; returns its path."""
    rows = np.asarray(joints, np.float32)
    return write_hdf5(path, joint=rows.reshape(len(rows), -1), **more)
