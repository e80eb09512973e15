"""Synthetic frames in the format of the NYU data set: whole depth images in mm, and joint_data.mat
with the labels.
"""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import scipy.io
from numpy.typing import ArrayLike, NDArray

from handpose.body.nyu import ANNOTATED_JOINTS, ANNOTATION_OF_JOINT, CENTER_JOINT, frame_name
from handpose.datasets import nyu_files
from handpose.frames.cameras import NYU
from handpose.frames.crops import restore_joints, window
from handpose.synthetic.generator import BLOCK, Generator, Scene, Split
from netlib.blob import Array

# Annotated joints that the model lacks, and the two joints between which they are put.
_STAND_INS = {26: (25, 27), 29: (28, 28), 33: (32, 32), 35: (32, 32)}


def write_data_set(root: Path, counts: dict[Split, int]) -> Path:
    """Write some frames of splits into the folders root/train and root/test; returns root."""
    for split, count in counts.items():
        folder, joints = root / split, []
        folder.mkdir(parents=True)
        for number in range(-(-count // BLOCK)):
            scene = Generator(0, split).scene(number)
            for n in range(min(BLOCK, count - number * BLOCK)):
                cv2.imwrite(
                    str(folder / frame_name(number * BLOCK + n)), pack_depth(whole_image(scene, n))
                )
            center = scene.camera.unproject(scene.center_uvd)
            joints.append(
                annotation_of(
                    restore_joints(scene.bodies.joints, center, scene.cube_mm / 2), center
                )
            )
        write_annotation(folder / nyu_files.ANNOTATION, np.concatenate(joints)[:count])
    return root


def annotation_of(joints: ArrayLike, center: ArrayLike) -> Array:
    """The 36 annotated joints in mm for model joints (N, 31, 3) and crop centres (N, 3); others
    are interpolated.
    """
    joints = np.asarray(joints, dtype=np.float64)
    xyz = np.zeros((len(joints), ANNOTATED_JOINTS, 3))
    xyz[:, list(ANNOTATION_OF_JOINT)] = joints
    xyz[:, CENTER_JOINT] = center
    for j, (a, b) in _STAND_INS.items():
        xyz[:, j] = (xyz[:, a] + xyz[:, b]) / 2
    return xyz


def write_annotation(path: Path, xyz: Array) -> None:
    """Write a ``joint_data.mat`` of one camera, version 5; xyz (N, 36, 3) mm, camera axes."""
    scipy.io.savemat(
        str(path), {"joint_uvd": NYU.project(xyz)[None], "joint_xyz": xyz[None]}, appendmat=False
    )


def whole_image(scene: Scene, n: int) -> NDArray[np.float64]:
    """The whole depth image (height, width) in mm of frame ``n`` of a block; 0 outside its crop.

    Every pixel of the crop fills its image pixels.
    """
    camera, half = scene.camera, scene.cube_mm / 2
    center = scene.center_uvd[n : n + 1]
    crop = scene.depth[n].astype(np.float64)
    mm = np.where(crop <= -1, np.floor(center[0, 2] - half), np.rint(center[0, 2] + crop * half))
    mm[crop >= 1] = 0
    picked = window(center, scene.cube_mm, camera)
    image = np.zeros((camera.height, camera.width))
    across, i = _enlarged(picked.columns[0], camera.width)
    down, j = _enlarged(picked.rows[0], camera.height)
    image[down, across] = mm[np.ix_(j, i)]
    return image


def _enlarged(picked: NDArray[np.int64], pixels: int) -> tuple[slice, NDArray[np.int64]]:
    """Along one axis, the image pixels that a crop covers, and for each the last crop pixel
    at or before it.
    """
    shown = np.flatnonzero(picked >= 0)
    at = picked[shown]
    step = int(np.ceil((at[-1] - at[0]) / max(len(at) - 1, 1)))
    covered = np.arange(at[0], min(at[-1] + max(step, 1), pixels))
    return slice(covered[0], covered[-1] + 1), shown[np.searchsorted(at, covered, side="right") - 1]


def pack_depth(depth: ArrayLike) -> NDArray[np.uint8]:
    """The inverse of ``images.unpack_depth``: whole mm (H, W) below 65536 to the pixels
    (H, W, 3) of a frame.
    """
    mm = np.asarray(depth).astype(np.uint16)
    return np.stack([mm & 255, mm >> 8, np.zeros_like(mm)], axis=-1).astype(np.uint8)
