"""DeepPrior's last layer (Oberweger et al. 2015, Sec. 3.2): joints as a mean and a few principal components.

joints = mean + sum over k of number[k] * component[k]

Components are scaled by their standard deviation, so the numbers of the bottleneck have about unit size.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from netlib import hdf5

BOTTLENECK = 30  # components


def write_components(path: Path, files: Sequence[Path]) -> None:
    """Write weights of the layer "joints": mean and largest principal components of the joints in the files."""
    count, total, products = 0, 0.0, 0.0
    for source in files:
        joints = hdf5.File(source, ("joint",)).datasets[0][:].astype(np.float64)
        count, total, products = count + len(joints), total + joints.sum(axis=0), products + joints.T @ joints
    mean = np.asarray(total / count)
    values, vectors = np.linalg.eigh(products / count - np.outer(mean, mean))
    scaled = vectors[:, ::-1][:, :BOTTLENECK] * np.sqrt(np.maximum(values[::-1][:BOTTLENECK], 0))
    with hdf5.written(path) as file:
        file["data/joints/0"], file["data/joints/1"] = scaled.astype(np.float32), mean.astype(np.float32)
