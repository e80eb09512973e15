"""Labelled crops, as the HDF5 files of a data set hold them: one array per data set, one row per
frame; examples.

depth       (n, 1, 128, 128) float32  the crop in [-1, 1]; crops.py
joint       (n, 3 K) float32          joints x, y, z in half-cubes from the crop centre,
                                      clipped to [-1, 1]
dof         (n, D) float32            inputs of the model that posed the frame; of
                                      synthetic frames of bodies that are alone
bones       (n, K) float32            the signed bone lengths that it was posed with,
                                      half-cubes; likewise
center      (n, 3) float32            crop centre in mm, camera axes
center_uvd  (n, 3) float32            the same in px, px, mm
index       (n,) int64                0-based number of the frame in its split
half_cube   (n,) float32              mm
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from handpose.frames.cameras import Camera, Floats
from handpose.frames.crops import BACKGROUND, SIZE
from handpose.frames.images import read_crop
from netlib.blob import Array
from netlib.errors import DataError
from netlib.files.hdf5 import File, read_list


@dataclass(frozen=True, kw_only=True)
class Frames:
    """n frames; the names and their order are those of the data sets in the files."""

    depth: Floats
    joint: Floats
    dof: Floats | None = None
    bones: Floats | None = None
    center: Floats
    center_uvd: Floats
    index: NDArray[np.int64]
    half_cube: Floats

    @classmethod
    def of(
        cls,
        crops: ArrayLike,
        joints: Array,
        center_uvd: Array,
        camera: Camera,
        half_cube: ArrayLike,
        index: NDArray[np.int64],
        dof: Array | None = None,
        bones: Array | None = None,
    ) -> Frames:
        """Frames from arrays of other shapes and types; joints are clipped.

        crops       (n, 128, 128) in [-1, 1]
        joints      (n, K, 3) in half-cubes
        center_uvd  (n, 3) px, px, mm
        half_cube   mm: one number, or (n,)
        """
        n, K, _ = joints.shape
        joint = np.clip(joints, -1, 1).reshape(n, 3 * K)
        return cls(
            depth=np.asarray(crops, np.float32).reshape(n, 1, SIZE, SIZE),
            joint=joint.astype(np.float32),
            center=camera.unproject(center_uvd).astype(np.float32),
            center_uvd=center_uvd.astype(np.float32),
            index=index,
            half_cube=np.broadcast_to(half_cube, n).astype(np.float32),
            dof=None if dof is None else dof.astype(np.float32),
            bones=None if bones is None else bones.astype(np.float32),
        )

    def __len__(self) -> int:
        return len(self.index)

    def arrays(self) -> dict[str, Array]:
        """All arrays by name, in the order of the files."""
        return {name: array for name, array in vars(self).items() if array is not None}

    def rows(self, rows: slice) -> Frames:
        """Some of the frames."""
        return Frames(**{name: array[rows] for name, array in self.arrays().items()})


# ----------------------------------------------------------------------------------------- examples


# A crop (size, size) in [-1, 1], whose pixels that were not finite show the background; its joints
# (3 K) in half-cubes, if known; its file and row.
Example = tuple[Floats, Array | None, str]


def examples_of(path: Path, count: int) -> list[Example]:
    """At most ``count`` frames, spread evenly over a data set, for display. Raises DataError.

    path  a list of HDF5 files, one such file, or a folder of crops
    """
    if path.is_dir():
        pictures = sorted(file for file in path.iterdir() if file.suffix.lower() == ".png")
        if not pictures:
            raise DataError(f"{path}: no PNG pictures in this folder; expected crops")
        chosen = [pictures[i] for i in spread(len(pictures), count)]
        return [(read_crop(picture), None, str(picture)) for picture in chosen]
    paths = [path] if path.suffix == ".h5" else read_list(str(path), None)
    rows = [(file, row) for file in map(_open, paths) for row in range(file.rows)]
    return [_example(*rows[i]) for i in spread(len(rows), count)]


def spread(total: int, count: int) -> NDArray[np.int_]:
    """At most ``count`` of ``total`` indices, evenly spread, including the first and the last."""
    return np.linspace(0, total - 1, min(total, count)).astype(int)


def _open(path: Path) -> File:
    """A file of crops, with joints if it has them. Raises DataError."""
    file = File(path, ("depth",))
    shape = file.datasets[0].shape
    are_squares = len(shape) >= 3 and shape[-1] == shape[-2]
    if not are_squares or math.prod(shape[1:]) != shape[-1] * shape[-2]:
        raise DataError(
            f"{path}: data set 'depth' has shape {shape}, expected square crops (N, 1, size, size)"
        )
    return File(path, ("depth", "joint")) if "joint" in file.names else file


def _example(file: File, row: int) -> Example:
    crop, *stored = (dataset[row] for dataset in file.datasets)
    with np.errstate(all="ignore"):  # the numbers may be of any type
        depth = crop.reshape(crop.shape[-2:]).astype(np.float32)
        joints = stored[0].astype(np.float64) if stored else None
    depth[~np.isfinite(depth)] = BACKGROUND
    return depth, joints, f"{file.path}: frame {row}"
