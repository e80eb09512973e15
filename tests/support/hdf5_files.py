"""HDF5 files of given arrays."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import h5py


def write_hdf5(path: Path, **datasets: Any) -> Path:
    """Write a file of data sets; returns its path."""
    with h5py.File(path, "w") as file:
        for name, values in datasets.items():
            file[name] = values
    return path
