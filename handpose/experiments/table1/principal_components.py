"""DeepPrior's last layer (Oberweger et al. 2015, Sec. 3.2): joints as a mean and a few principal components.

joints = mean + sum over k of number[k] * component[k]

Components are scaled by their standard deviation, so the numbers of the bottleneck have about unit size.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from netlib.blob import Array
from netlib.errors import DataError
from netlib.files import hdf5

BOTTLENECK = 30  # components


def write_components(path: Path, files: Sequence[Path]) -> None:
    """Write weights of the layer "joints": mean and largest principal components of the joints in the files.

    Raises DataError.
    """
    parts: list[Array] = []
    for source in files:
        joints = hdf5.File(source, ("joint",)).datasets[0].numbers()
        if joints.ndim != 2 or any(joints.shape[1] != other.shape[1] for other in parts):
            raise DataError(f"{source}: data set 'joint' has shape {joints.shape}, expected (N, 3 K), as in all files")
        if not np.isfinite(joints).all():
            raise DataError(f"{source}: data set 'joint' has values that are not finite")
        parts.append(joints)
    joints = np.concatenate(parts)
    mean = joints.mean(axis=0)
    values, vectors = np.linalg.eigh(joints.T @ joints / len(joints) - np.outer(mean, mean))
    scaled = vectors[:, ::-1][:, :BOTTLENECK] * np.sqrt(np.maximum(values[::-1][:BOTTLENECK], 0))
    with hdf5.created(path) as file:
        file["data/joints/0"], file["data/joints/1"] = scaled.astype(np.float32), mean.astype(np.float32)
