"""The files of the NYU hand pose data set: a folder per split, with depth frames and
joint_data.mat, the annotation.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from handpose.body.nyu import (
    ANNOTATED_JOINTS,
    ANNOTATION_OF_JOINT,
    CENTER_JOINT,
    CUBE_MM,
    TEST_FRAMES,
    TRAIN_FRAMES,
    cube_of_test_frame,
    frame_name,
)
from handpose.datasets.published_frames import Flaw, PublishedFrames, check_frames, read_centers
from handpose.frames.cameras import NYU
from handpose.frames.images import WRONG_SIZE, BadFrameError, errors_of, read_png, unpack_depth
from netlib.blob import Array
from netlib.errors import DataError

ANNOTATION = "joint_data.mat"  # in the folder of the depth frames of each split


def read_nyu_depth(path: str | Path) -> NDArray[np.float32]:
    """Depth (480, 640) in mm of one frame; 0 where the camera read nothing. Raises BadFrameError.

    The file is an RGB image: depth = 256 green + blue, as 16-bit grey would be (red is unused).
    """
    image = read_png(path)
    if image.ndim != 3 or image.shape[2] < 3 or image.dtype != np.uint8:
        found = f"found {image.dtype} of shape {image.shape}, expected 8-bit RGB packing the depth"
        raise BadFrameError(path, WRONG_SIZE, found)
    return unpack_depth(image)


# ----------------------------------------------------------------------------------- the annotation


class NyuAnnotation(NamedTuple):
    """The joints of one split in the first of the three cameras."""

    uvd: Array  # (N, 36, 3) px, px, mm
    xyz: Array  # (N, 36, 3) mm, camera axes: x right, y up, z away


def read_annotation(path: Path) -> NyuAnnotation:
    """The joints in a ``joint_data.mat``, of MATLAB's version 5. Raises DataError."""
    if not path.is_file():
        raise DataError(
            f"{path}: no such file; it holds the joints, and comes in the same archive as the depth frames"
        )
    with errors_of(str(path), "the labels", "not a readable MATLAB file, perhaps truncated"):
        found = _read_matlab(path)
    for name in ("joint_uvd", "joint_xyz"):
        array = found[name]
        if (
            array.ndim != 4
            or array.shape[2:] != (ANNOTATED_JOINTS, 3)
            or array.dtype.kind not in "fiu"
        ):
            raise DataError(
                f"{path}: {name} is {array.dtype} of shape {array.shape}, expected numbers "
                f"(cameras, frames, {ANNOTATED_JOINTS}, 3)"
            )
    uvd, xyz = (np.array(found[name][0], dtype=np.float64) for name in ("joint_uvd", "joint_xyz"))
    if len(uvd) != len(xyz) or not len(uvd):
        raise DataError(
            f"{path}: joint_uvd has {len(uvd)} frames, joint_xyz {len(xyz)}; expected the same, not 0"
        )
    _check_axes(path, uvd, xyz)
    return NyuAnnotation(uvd, xyz)


def _read_matlab(path: Path) -> dict[str, Any]:
    """The variables of a file of version 5."""
    import scipy.io  # imported here: it takes a tenth of a second

    if scipy.io.matlab.matfile_version(str(path))[0] == 0:
        raise DataError(f"{path}: a MATLAB file of version 4, or none; expected version 5")
    names = [name for name, _, _ in scipy.io.whosmat(str(path))]
    for name in ("joint_uvd", "joint_xyz"):
        if name not in names:
            raise DataError(
                f"{path}: no variable {name!r}; it has {', '.join(sorted(names)) or 'none'}"
            )
    return dict(scipy.io.loadmat(str(path), variable_names=["joint_uvd", "joint_xyz"]))


def _check_axes(path: Path, uvd: Array, xyz: Array) -> None:
    """Raise DataError unless pixels and mm describe the same points, in our camera axes."""
    some = slice(None, None, max(len(uvd) // 2000, 1))
    if not (np.isfinite(uvd[some]) & np.isfinite(xyz[some])).any(axis=(0, 1)).all():
        raise DataError(f"{path}: joint_uvd and joint_xyz have no joint that is finite in both")
    with np.errstate(all="ignore"):
        difference = np.nanmedian(np.abs(NYU.unproject(uvd[some]) - xyz[some]), axis=(0, 1))
    if not (difference < 5).all():
        raise DataError(
            f"{path}: joint_xyz is not where joint_uvd is, off by x {difference[0]:.0f}, "
            f"y {difference[1]:.0f}, z {difference[2]:.0f} mm with NYU's camera; expected y up, z away"
        )


# --------------------------------------------------------------------------------------- the frames


def folder_of(root: Path, split: str) -> Path:
    """The folder of a split: ROOT/train, or ROOT/dataset/train, as the archive has it."""
    inner = root / "dataset" / split
    return inner if inner.is_dir() and not (root / split).is_dir() else root / split


def read_split(root: Path, split: str, centers: Path | None = None) -> PublishedFrames:
    """The frames of a split.

    ``centers`` is a file of crop centres; without it joint 34. Raises DataError.
    """
    folder = folder_of(root, split)
    annotation = read_annotation(folder / ANNOTATION)
    count = len(annotation.uvd)
    center_uvd, centre = annotation.uvd[:, CENTER_JOINT], f"annotated joint {CENTER_JOINT}"
    if centers is not None:
        center_uvd, centre = read_centers(centers, count)
    is_test = split == "test"
    cube_mm = cube_of_test_frame(np.arange(count)) if is_test else np.full(count, CUBE_MM)
    return PublishedFrames(
        split=split,
        files=[folder / frame_name(i) for i in range(count)],
        center_uvd=center_uvd,
        joints=annotation.xyz[:, list(ANNOTATION_OF_JOINT)],
        cube_mm=cube_mm,
        camera=NYU,
        read=read_nyu_depth,
        made_from="NYU",
        centre=centre,
    )


def check_split(root: Path, split: str) -> tuple[list[str], list[Flaw]]:
    """The content of a split, and its errors, one line each."""
    folder = folder_of(root, split)

    def whole(count: int) -> list[Flaw]:
        expected = TEST_FRAMES if split == "test" else TRAIN_FRAMES
        if count == expected:
            return []
        text = (
            f"{folder / ANNOTATION}: {count} labelled frames, the whole {split} set has {expected}"
        )
        return [Flaw(text, fatal=count > expected)]

    holds = f"{frame_name(0)} ... and {ANNOTATION}"
    return check_frames(root, folder, holds, lambda: read_split(root, split), whole)
