"""Synthetic frames in the format of the NYU data set: whole depth images, and joint_data.mat with the annotation.

Depth is in whole mm there. A split is complete when its annotation, which is written last, exists.
"""

from __future__ import annotations

import contextlib
import json
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from handpose.body.nyu import CUBE_MM, frame_name
from handpose.datasets import nyu_files, parts
from handpose.frames.cameras import NYU
from handpose.frames.crops import restore_joints, window
from handpose.frames.images import pack_depth
from handpose.synthetic.generator import BLOCK, Generator, Recipe, Scene, Split
from handpose.synthetic.workers import no_interrupt, processes
from netlib import files
from netlib.blob import Array
from netlib.errors import DataError
from netlib.files import atomic
from netlib.files.paths import names_in

FRAME_BYTES = 60_000  # upper bound of the size of a frame on the disk
MARKER = "synthetic.json"  # marks our folders, with their recipe


class RawDataSet:
    """Synthetic frames of some splits in NYU's format, in a folder per split.

    out      the folder of these folders
    counts   frames per split
    recipe   of the frames; with NYU's camera
    force    write everything again, even into a folder with other files

    Raises DataError for a folder with other files, for other cameras, and for other cubes, which the annotation cannot
    represent.
    """

    def __init__(
        self, out: Path, seed: int, counts: Mapping[Split, int], recipe: Recipe | None = None, force: bool = False
    ) -> None:
        self.out, self.counts = out, counts
        self.missing = []
        recipe = recipe or Recipe()
        if any(view.camera != NYU for view in recipe.views):
            raise DataError("NYU's format is for frames of NYU's camera; expected a recipe without others")
        for cube_mm in (recipe.prior.cube_mm, *(subject.cube_mm for subject in recipe.others)):
            if cube_mm != CUBE_MM:
                raise DataError(f"NYU's format holds no cubes, they are taken for {CUBE_MM:g} mm; this recipe also has "
                                f"one of {cube_mm:g} mm: make it without --raw")
        for generator in (Generator(seed, split, recipe) for split in counts):
            folder = out / generator.split
            marker = atomic.text_of(folder / MARKER)
            if not force and marker is None and names_in(folder):
                raise DataError(f"{folder}: holds what this tool did not make; choose another --out, or use --force")
            if force or marker != self._recipe(generator) or not (folder / nyu_files.ANNOTATION).is_file():
                self.missing.append(generator)

    def _recipe(self, generator: Generator) -> str:
        return json.dumps({**generator.made_from(), "frames": self.counts[generator.split]}, sort_keys=True)

    @property
    def is_whole(self) -> bool:
        """True if nothing is left to be written."""
        return not self.missing

    @property
    def missing_frames(self) -> int:
        """The number of frames to be written."""
        return sum(self.counts[generator.split] for generator in self.missing)

    def write(self, workers: int, advance: Callable[[int], None]) -> None:
        """Write the missing files. Raises DataError, OSError.

        workers  number of processes
        advance  called with the number of further frames; its exceptions end the run and keep complete splits only.
        """
        parts.check_room(self.out, self.missing_frames * FRAME_BYTES)
        for generator in self.missing:
            self._write_split(generator, workers, advance)

    def _write_split(self, generator: Generator, workers: int, advance: Callable[[int], None]) -> None:
        folder, count = self.out / generator.split, self.counts[generator.split]
        files.make_folder(folder)
        (folder / nyu_files.ANNOTATION).unlink(missing_ok=True)
        for name in names_in(folder) if (folder / MARKER).exists() else ():  # from an earlier run
            if name.startswith("depth_1_") and name.endswith(".png"):
                (folder / name).unlink()
        atomic.replace_text(folder / MARKER, self._recipe(generator))
        joints = []
        for block in _blocks(generator, count, folder, workers):
            joints.append(block)
            advance(len(block))
        nyu_files.write_annotation(folder / nyu_files.ANNOTATION, np.concatenate(joints), nyu_files.SYNTHETIC)


def _blocks(generator: Generator, count: int, folder: Path, workers: int) -> Iterator[Array]:
    """Write the images block by block, here or in processes; yields the annotated joints of each block in order."""
    numbers = range(-(-count // BLOCK))
    if workers == 1:
        yield from (write_block(generator, number, folder, count) for number in numbers)
        return
    with contextlib.ExitStack() as stack:
        pool = stack.enter_context(processes(workers))
        with no_interrupt():
            jobs = [pool.submit(write_block, generator, number, folder, count) for number in numbers]
        yield from (job.result() for job in jobs)


def write_block(generator: Generator, number: int, folder: Path, count: int) -> Array:
    """Write the images of a block, up to frame ``count``; returns their annotated joints (n, 36, 3) in mm."""
    scene = generator.scene(number)
    for n in range(min(BLOCK, count - number * BLOCK)):
        # level 1 is twice as fast as OpenCV's default, and these images are mostly empty
        packed = pack_depth(whole_image(scene, n))
        png = cv2.imencode(".png", packed, (cv2.IMWRITE_PNG_COMPRESSION, 1))[1].tobytes()
        path = folder / frame_name(number * BLOCK + n)
        atomic.replace(path, lambda temporary, png=png: temporary.write_bytes(png), sync=False)  # type: ignore[misc]
    center = scene.camera.unproject(scene.center_uvd)
    xyz = restore_joints(scene.bodies.joints, center, scene.cube_mm / 2)
    return nyu_files.annotation_of(xyz, center)[: count - number * BLOCK]


def whole_image(scene: Scene, n: int) -> NDArray[np.float64]:
    """The whole depth image (height, width) in mm of frame ``n`` of a block; 0 outside its crop.

    Every pixel of the crop fills its image pixels.
    """
    camera, cube_mm = scene.camera, scene.cube_mm
    half = cube_mm / 2
    center = scene.center_uvd[n : n + 1]
    crop = scene.depth[n].astype(np.float64)
    mm = np.where(crop <= -1, np.floor(center[0, 2] - half), np.rint(center[0, 2] + crop * half))
    mm[crop >= 1] = 0
    picked = window(center, cube_mm, camera)
    image = np.zeros((camera.height, camera.width))
    across, i = _enlarged(picked.columns[0], camera.width)
    down, j = _enlarged(picked.rows[0], camera.height)
    image[down, across] = mm[np.ix_(j, i)]
    return image


def _enlarged(picked: NDArray[np.int64], pixels: int) -> tuple[slice, NDArray[np.int64]]:
    """Along one axis, the image pixels that a crop covers, and for each of them the crop pixel that shows it.

    That is the last one picked at or before it.
    """
    shown = np.flatnonzero(picked >= 0)
    at = picked[shown]
    step = int(np.ceil((at[-1] - at[0]) / max(len(at) - 1, 1)))
    covered = np.arange(at[0], min(at[-1] + max(step, 1), pixels))
    return slice(covered[0], covered[-1] + 1), shown[np.searchsorted(at, covered, side="right") - 1]
