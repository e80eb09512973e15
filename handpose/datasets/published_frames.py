"""The frames of a published data set, and the labelled crops made from them.

A frame that cannot be used is named, counted and left out.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from io import BufferedReader
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from handpose.datasets.frames import Frames, empty_frames
from handpose.frames.cameras import Camera
from handpose.frames.crops import crop, normalise_joints
from handpose.frames.images import EMPTY, OUTSIDE, UNLABELLED, WRONG_SIZE, BadFrameError
from netlib import files
from netlib.blob import Array
from netlib.errors import DataError, reason_of


@dataclass(frozen=True)
class Flaw:
    """One error of a data set: its message."""

    text: str
    fatal: bool = True  # the run cannot continue


def recognise(root: Path) -> str | None:
    """A description of the folder's likely content, or None if it is unknown."""
    try:
        names = {entry.name for entry in root.iterdir()}
    except OSError:
        return None
    below = {f"{a}/{b}" for a in names & {"train", "test", "Training", "Testing", "P0", "P1"} for b in _some(root / a)}
    if any(b.endswith("/joint_data.mat") or "/depth_1_" in b for b in below):
        return "the NYU hand pose data set"
    if {"Training", "Testing"} & names or "Training/labels.txt" in below:
        return "the ICVL data set"
    if {"P0", "P1"} & names:
        return "the MSRA15 data set"
    if any(name.endswith(".h5") for name in names):
        return "HDF5 files that are prepared already"
    packed = sorted(name for name in names if name.lower().endswith((".zip", ".tar", ".gz", ".7z", ".rar", ".tgz")))
    if packed:
        return f"an archive that is not unpacked ({packed[0]})"
    if names and all(name.endswith((".txt", ".md")) for name in names):
        return "only text files, as of published predictions and ground truth, no depth frames"
    return None if names else "nothing"


def _some(folder: Path) -> list[str]:
    """Some names in a folder, including those of labels."""
    found = [name for name in ("joint_data.mat", "labels.txt") if (folder / name).is_file()]
    with contextlib.suppress(OSError), os.scandir(folder) as entries:
        found += [entry.name for entry, _ in zip(entries, range(1000))]
    return found


def first_frame_flaws(path: Path, read: Callable[[Path], NDArray[Any]], camera: Camera) -> list[Flaw]:
    """The errors of the first frame of a split: damage, which is not fatal, or another size than the camera's."""
    try:
        shape = read(path).shape
    except BadFrameError as error:
        return [Flaw(str(error), fatal=error.kind == WRONG_SIZE)]
    if shape != (camera.height, camera.width):
        return [Flaw(f"{path}: {shape[1]} x {shape[0]} pixels, expected {camera.width} x {camera.height}")]
    return []


@dataclass(frozen=True)
class PublishedFrames:
    """The annotated frames of one split."""

    split: str  # "train" or "test"
    files: Sequence[Path]  # depth images, N
    center_uvd: Array  # (N, 3) middles of the cubes: px, px, mm
    joints: Array  # (N, K, 3) mm, camera axes
    cube_mm: Array  # (N,) edges of the cubes
    camera: Camera
    read: Callable[[Path], Array]  # depth image in mm; raises BadFrameError
    made_from: str
    centre: str  # description of the centres

    def __len__(self) -> int:
        return len(self.files)

    def columns(self) -> dict[str, Array]:
        """Arrays without rows, of the shapes and types of a part's."""
        return empty_frames(self.joints.shape[1]).arrays()

    def crops(self, start: int, stop: int) -> tuple[Frames, list[tuple[int, BadFrameError]]]:
        """The labelled crops of frames ``start`` to ``stop``, and the bad frames with their index."""
        crops, good, bad = [], [], []
        for i in range(start, stop):
            try:
                crops.append(self.crop(i))
                good.append(i)
            except BadFrameError as error:
                bad.append((i, error))
        some = np.array(good, np.int64)
        center_uvd, half = self.center_uvd[some], np.asarray(self.cube_mm[some] / 2)
        joints = normalise_joints(self.joints[some], self.camera.unproject(center_uvd), half)
        return Frames.of(np.asarray(crops), joints, center_uvd, self.camera, half, some), bad

    def crop(self, i: int) -> NDArray[np.float32]:
        """The crop of frame ``i``. Raises BadFrameError."""
        path, center = self.files[i], self.center_uvd[i]
        if not (np.isfinite(center).all() and center[2] > 0 and np.isfinite(self.joints[i]).all()):
            raise BadFrameError(path, UNLABELLED)
        depth = self.read(path)
        if depth.shape != (self.camera.height, self.camera.width):
            expected = f"{self.camera.width} x {self.camera.height}"
            raise BadFrameError(path, WRONG_SIZE, f"{depth.shape[1]} x {depth.shape[0]} pixels, expected {expected}")
        try:
            made = crop(depth, center, float(self.cube_mm[i]), self.camera)
        except DataError as error:
            raise BadFrameError(path, OUTSIDE, str(error)) from None
        if not (np.abs(made) < 1).any():
            u, v, d = center
            raise BadFrameError(path, EMPTY, f"within {self.cube_mm[i] / 2:g} mm of u {u:.0f}, v {v:.0f}, {d:.0f} mm")
        return made

    def flaw(self, i: int) -> str | None:
        """The kind of error of frame ``i``, None if it has none."""
        try:
            self.crop(i)
        except BadFrameError as error:
            return error.kind
        return None

    def recipe(self, start: int, stop: int) -> str:
        """The recipe of the crops of frames ``start`` to ``stop``; it has the names and sizes of the images only."""
        digest = hashlib.sha256()
        for array in (self.center_uvd, self.joints, self.cube_mm):
            digest.update(np.ascontiguousarray(array[start:stop], dtype="<f8").tobytes())
        for path in self.files[start:stop]:
            try:
                size = path.stat().st_size
            except OSError:
                size = -1
            digest.update(f"{path.parent.name}/{path.name} {size}\n".encode())
        facts = {
            "version": 1,
            "made_from": self.made_from,
            "split": self.split,
            "camera": self.camera.name,
            "centre": self.centre,
            "start": start,
            "frames": stop - start,
            "sha256": digest.hexdigest(),
        }
        return json.dumps(facts, sort_keys=True)


def statistics(frames: PublishedFrames, index: Sequence[int]) -> str:
    """A line of statistics in mm of the frames ``index``, with their centre and cube."""
    few = np.asarray(index)
    offset = frames.joints[few] - frames.camera.unproject(frames.center_uvd[few])[:, None]
    cubes, counts = np.unique(frames.cube_mm[few].round(3), return_counts=True)
    ranges = ", ".join(
        f"{axis} {offset[..., i].min():.0f} to {offset[..., i].max():.0f}" for i, axis in enumerate("xyz")
    )
    clipped = (np.abs(offset) > frames.cube_mm[few, None, None] / 2).any(axis=(1, 2)).mean()
    cube = " and ".join(f"{c:g} mm ({n} frames)" if len(cubes) > 1 else f"{c:g} mm" for c, n in zip(cubes, counts))
    return (
        f"joints {ranges} mm from the centre ({frames.centre}), cube {cube}; "
        f"{clipped:.1%} of the frames have a joint outside the cube, which is clipped"
    )


def read_centers(path: Path, frames: int) -> Array:
    """Crop centres (frames, 3) from a text file of one ``u v d`` per line, or an .npy or .npz file. Raises DataError.

    In an .npz file the array is called center_uvd, or is the only one.
    """
    if path.suffix in (".npy", ".npz"):
        found = _array_in(path)
    else:
        lines = files.read_text(path, "the centres").split("\n")
        lines = lines[:-1] if lines and not lines[-1].strip() else lines
        found = np.array([_numbers(path, i, line, 3) for i, line in enumerate(lines, 1)]).reshape(-1, 3)
    if found.shape != (frames, 3):
        raise DataError(f"{path}: found centres of shape {found.shape}, expected ({frames}, 3): u v d for each frame")
    return found


def _array_in(path: Path) -> Array:
    """The array in an .npy or .npz file. Raises DataError."""
    with BufferedReader(files.opened(path, "the centres")) as stream, warnings.catch_warnings():
        warnings.simplefilter("ignore")  # NumPy's, for unusual headers
        try:
            loaded = np.load(stream, allow_pickle=False)
            if isinstance(loaded, np.ndarray):
                return loaded.astype(np.float64)
            names = loaded.files
            name = "center_uvd" if "center_uvd" in names else names[0] if len(names) == 1 else ""
            if name:
                return np.asarray(loaded[name], dtype=np.float64)
        except Exception as error:  # for a damaged file NumPy's reader and the one of archives may raise any exception
            raise DataError(f"{path}: cannot read the centres: {reason_of(error)}") from None
    raise DataError(f"{path}: holds {', '.join(names) or 'nothing'}; expected an array center_uvd")


def _numbers(path: Path, line: int, text: str, count: int) -> list[float]:
    """The numbers of a line. Raises DataError."""
    try:
        values = [float(word) for word in text.replace(",", " ").split()]
    except ValueError:
        values = []
    if len(values) != count:
        raise DataError(f"{path}:{line}: expected {count} numbers, found {text.strip()[:60]!r}")
    return values
