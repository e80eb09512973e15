"""Labels: the joints in the frames of an HDF5 file, and their unit in mm.

docs/data.md lists everything that such a file holds. For computations with labels this module reads

    joint      (n, 3 K) or (n, K, 3)  half-cubes from the crop centre; -1 or 1 where clipped to the
                                      cube, NaN if unknown
    half_cube  (n,) or (n, 1)         mm, 25 to 5000; optional
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from handpose.body.nyu import CUBE_MM
from handpose.frames.cameras import CAMERAS, Camera
from handpose.frames.crops import CUBES_MM
from netlib.blob import Array
from netlib.errors import DataError
from netlib.files.hdf5 import File

MAX_CENTER_ERROR_PX = 0.01  # of a camera that maps the centres: the rounding of float32
MIN_OFF_AXIS_PX = 2.0  # on the optical axis all cameras agree
MAX_PX_OR_MM, MIN_CENTER_MM = 1e6, 1.0  # bounds of a crop centre's coordinates, and of its depth


@dataclass(frozen=True)
class Labels:
    """The labels of one file, in separate arrays.

    joints     (n, K, 3) half-cubes from the crop centre
    half_cube  (n,) mm
    made_from  description of the data
    """

    joints: Array
    half_cube: Array
    made_from: str

    @property
    def seen(self) -> NDArray[np.bool_]:
        """(n, K): True for joints at their true positions, False for joints clipped to the cube."""
        return np.asarray((np.abs(self.joints) < 1).all(axis=2))


def read(path: Path, count: int) -> Labels:
    """Read the labels of a file with ``count`` joints. Raises DataError."""
    file = File(path, ("joint",))
    shapes = (file.rows, 3 * count), (file.rows, count, 3)
    stored = _numbers(file, "joint", shapes, f"(N, {3 * count}) for {count} joints")
    joints = stored.reshape(file.rows, count, 3)
    infinite = np.isinf(joints).any(axis=(1, 2))
    if infinite.any():
        raise DataError(
            f"{path}: data set 'joint' is infinite in frame {infinite.argmax()} ({infinite.sum()} such frames), "
            "expected half-cubes from the crop centre, or NaN if unknown"
        )
    return Labels(joints, read_half_cubes(file), file.made_from)


def read_half_cubes(file: File) -> Array:
    """Half-cubes (n,) in mm of the frames of an open file, NYU's if it has none.

    Raises DataError.
    """
    if "half_cube" not in file.names:
        return np.full(file.rows, CUBE_MM / 2)
    shapes = (file.rows,), (file.rows, 1)
    expected = f"({file.rows},): mm, one number per frame"
    half_cube = _numbers(file, "half_cube", shapes, expected).reshape(file.rows)
    low, high = (edge / 2 for edge in CUBES_MM)
    wrong = ~((half_cube >= low) & (half_cube <= high))
    if wrong.any():
        first = wrong.argmax()
        raise DataError(
            f"{file.path}: data set 'half_cube' is {half_cube[first]:g} in frame {first} ({wrong.sum()} "
            f"such frames), expected mm, {low:g} to {high:g}"
        )
    return half_cube


def _numbers(file: File, name: str, shapes: Sequence[tuple[int, ...]], expected: object) -> Array:
    """A data set of an open file, of one of some shapes. Raises DataError."""
    stored = File(file.path, (name,)).datasets[0].numbers()
    if stored.shape not in shapes:
        found = f"data set {name!r} has shape {stored.shape}"
        raise DataError(f"{file.path}: {found}, expected {expected}")
    return stored


def read_crop_centers(files: Sequence[File]) -> tuple[Array, Camera]:
    """Crop centres (n, 3) of all frames, px, px, mm, and their camera. Raises DataError.

    Files have each centre in pixels and in mm, which determines the camera: that of ``CAMERAS``
    which maps them.
    """

    def stored(name: str) -> Array:
        """The centres of all files in a data set."""
        each = [_numbers(file, name, [(file.rows, 3)], (file.rows, 3)) for file in files]
        return np.concatenate(each)

    uvd, xyz = stored("center_uvd"), stored("center")
    # the quotients of larger coordinates may overflow
    are_small = np.abs([uvd, xyz]).max(initial=0) <= MAX_PX_OR_MM  # False for NaN
    if not are_small or not (xyz[:, 2] > MIN_CENTER_MM).all():
        raise DataError(
            f"{files[0].path}: crop centres that are not finite, or not before the camera"
        )
    cameras = [camera for camera in CAMERAS.values() if _maps(camera, xyz, uvd)]
    if len(cameras) != 1:
        raise DataError(
            f"{files[0].path}: its crop centres in px and in mm fit {len(cameras) or 'none'} of the cameras "
            f"{', '.join(CAMERAS)}; expected frames of one of them, not all of them in the middle"
        )
    return uvd, cameras[0]


def _maps(camera: Camera, xyz: Array, uvd: Array) -> bool:
    """True if a camera maps these points to these pixels, and some of them are off its axis."""
    error_px = np.abs(camera.project(xyz) - uvd)[:, :2].max()
    off_axis_px = np.abs(uvd[:, :2] - (camera.u0, camera.v0)).max(axis=0).min()
    return bool(error_px < MAX_CENTER_ERROR_PX and off_axis_px > MIN_OFF_AXIS_PX)
