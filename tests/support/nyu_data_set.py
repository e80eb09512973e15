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

# Annotated joints that the model lacks: each is the midpoint of two others.
_MIDPOINT_OF = {26: (25, 27), 29: (28, 28), 33: (32, 32), 35: (32, 32)}


def write_data_set(root: Path, counts: dict[Split, int]) -> Path:
    """Write this many frames of each split, and their labels, to root/train and root/test.

    Returns root.
    """
    for split, count in counts.items():
        folder = root / split
        folder.mkdir(parents=True)
        annotations = []
        for first in range(0, count, BLOCK):
            scene = Generator(0, split).scene(first // BLOCK)
            for n in range(min(BLOCK, count - first)):
                pixels = pack_depth(whole_image(scene, n))
                cv2.imwrite(str(folder / frame_name(first + n)), pixels)
            center = scene.camera.unproject(scene.center_uvd)
            joints = restore_joints(scene.bodies.joints, center, scene.cube_mm / 2)
            annotations.append(annotation_of(joints, center))
        write_annotation(folder / nyu_files.ANNOTATION, np.concatenate(annotations)[:count])
    return root


def annotation_of(joints: ArrayLike, center: ArrayLike) -> Array:
    """The annotated joints (N, 36, 3) in mm for model joints (N, 31, 3) and crop centres (N, 3).

    Joints that the model lacks are interpolated.
    """
    joints = np.asarray(joints, dtype=np.float64)
    xyz = np.zeros((len(joints), ANNOTATED_JOINTS, 3))
    xyz[:, list(ANNOTATION_OF_JOINT)] = joints
    xyz[:, CENTER_JOINT] = center
    for joint, (a, b) in _MIDPOINT_OF.items():
        xyz[:, joint] = (xyz[:, a] + xyz[:, b]) / 2
    return xyz


def write_annotation(path: Path, xyz: Array) -> None:
    """Write a ``joint_data.mat`` (version 5) of one camera for joints xyz (N, 36, 3) in mm, in
    camera coordinates.
    """
    arrays = {"joint_uvd": NYU.project(xyz)[None], "joint_xyz": xyz[None]}
    scipy.io.savemat(str(path), arrays, appendmat=False)


def whole_image(scene: Scene, n: int) -> NDArray[np.float64]:
    """The whole depth image (height, width) in mm of frame ``n`` of a block; 0 outside its crop.

    Every pixel of the crop fills its image pixels.
    """
    camera, half_mm = scene.camera, scene.cube_mm / 2
    center = scene.center_uvd[n : n + 1]
    center_mm = center[0, 2]
    depth = scene.depth[n].astype(np.float64)  # -1 at the near face of the cube, 1 at the far one
    mm = np.rint(center_mm + depth * half_mm)
    mm[depth <= -1] = np.floor(center_mm - half_mm)
    mm[depth >= 1] = 0
    crop = window(center, scene.cube_mm, camera)
    image = np.zeros((camera.height, camera.width))
    columns, crop_columns = _enlarged(crop.columns[0], camera.width)
    rows, crop_rows = _enlarged(crop.rows[0], camera.height)
    image[rows, columns] = mm[np.ix_(crop_rows, crop_columns)]
    return image


def _enlarged(image_pixels: NDArray[np.int64], size: int) -> tuple[slice, NDArray[np.int64]]:
    """Along one axis, the image pixels that a crop covers, and for each the last crop pixel
    at or before it.

    image_pixels  the image pixel of each crop pixel, negative outside the image
    size          pixels of the image
    """
    inside = np.flatnonzero(image_pixels >= 0)
    samples = image_pixels[inside]
    first, last = samples[0], samples[-1]
    step = int(np.ceil((last - first) / max(len(samples) - 1, 1)))
    end = min(last + max(step, 1), size)
    sources = np.searchsorted(samples, np.arange(first, end), side="right") - 1
    return slice(first, end), inside[sources]


def pack_depth(depth: ArrayLike) -> NDArray[np.uint8]:
    """The pixels (H, W, 3) of a frame for whole mm (H, W) below 65536; ``images.unpack_depth``
    is the inverse.
    """
    mm = np.asarray(depth).astype(np.uint16)
    return np.stack([mm & 255, mm >> 8, np.zeros_like(mm)], axis=-1).astype(np.uint8)
