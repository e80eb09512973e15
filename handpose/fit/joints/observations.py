"""Annotated frames of one person for calibration, from HDF5 files."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from handpose.body.nyu import CUBE_MM, EVALUATION_JOINTS
from handpose.datasets import icvl, labels
from handpose.fit.joints.calibration_problem import MIN_FRAMES
from layers.hand.skeleton import Skeleton
from netlib.blob import Array
from netlib.errors import DataError
from netlib.files.hdf5 import read_list

# Joints of files with fewer joints than the skeleton, by both numbers of joints.
PARTS = {(31, 14): EVALUATION_JOINTS, (21, len(icvl.JOINTS)): tuple(range(len(icvl.JOINTS)))}


@dataclass(frozen=True)
class Observations:
    """Annotated frames, as HDF5 files have them.

    targets    (N, K, 3) half-cubes of each frame, from the crop centre; NaN where cut off by the cube, or unknown
    joints     (K,) indices in the skeleton
    half_cube  (N,) mm
    unseen     number of NaN joints
    rows       number of frames in the files
    """

    targets: Array
    joints: tuple[int, ...]
    half_cube: Array
    unseen: int
    rows: int


def read_observations(
    path: str | Path,
    skeleton: Skeleton,
    joints: int | None = None,
    frames: int | None = None,
    seed: int = 0,
    half_cube: float = CUBE_MM / 2,
) -> Observations:
    """Joints from an HDF5 file, or from those in a list (.txt). Raises DataError.

    joints     number of joints to use, those of PARTS; by default all
    frames     number of frames, drawn at random; by default all; only those with half of the joints or more in the cube
    half_cube  mm, if the file has none
    """
    files = read_list(str(path), None) if Path(path).suffix == ".txt" else [Path(path)]
    K = len(skeleton.parents)
    known = {K: tuple(range(K)), **{few: part for (all_, few), part in PARTS.items() if all_ == K}}
    parts = [labels.read(file, known, half_cube) for file in files]
    counts = sorted({part.joints.shape[1] for part in parts})
    if len(counts) > 1:
        raise DataError(f"{path}: some files have {counts[0]} joints, others {counts[-1]}; expected as many in all")
    there = known[counts[0]]
    chosen = there if joints is None else known.get(joints, ())
    if not chosen or not set(chosen) <= set(there):
        raise DataError(f"{path}: has {len(there)} joints of a skeleton of {K}; {joints} cannot be taken of them")
    columns = [there.index(j) for j in chosen]
    stored = np.concatenate([part.joints for part in parts])[:, columns]
    half = np.concatenate([part.half_cube for part in parts])
    unseen = ~np.concatenate([part.seen for part in parts])[:, columns]
    usable = np.flatnonzero(2 * unseen.sum(axis=1) <= len(chosen))
    if len(usable) < MIN_FRAMES:
        raise DataError(
            f"{path}: {len(usable)} of {len(stored)} frames have half of their joints within the cube (-1 to 1), "
            f"expected {MIN_FRAMES} or more"
        )
    if frames is not None and frames < len(usable):
        usable = np.sort(np.random.default_rng(seed).choice(usable, frames, replace=False))
    targets = np.where(unseen[usable][:, :, None], np.nan, stored[usable])
    return Observations(targets, chosen, half[usable], int(unseen[usable].sum()), len(stored))
