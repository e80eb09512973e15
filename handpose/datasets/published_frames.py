"""The frames of a published data set, and the files that nets read: parts, their list, and a list
of bad frames.

Crops are made on threads. A frame that cannot be used is named, counted and left out.
"""

from __future__ import annotations

import hashlib
import json
import warnings
from collections import Counter
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from handpose.datasets import parts
from handpose.datasets.frames import Frames
from handpose.datasets.parts import Part, write_part
from handpose.frames.cameras import Camera
from handpose.frames.crops import SIZE, crop, normalise_joints
from handpose.frames.images import EMPTY, OUTSIDE, UNLABELLED, WRONG_SIZE, BadFrameError
from netlib import files
from netlib.blob import Array
from netlib.errors import DataError, reason_of, some_of
from netlib.files import atomic, hdf5
from netlib.files.paths import names_in


@dataclass(frozen=True)
class Flaw:
    """One error of a data set: its message."""

    text: str
    fatal: bool = True  # the run cannot continue


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

    def crops(self, start: int, stop: int) -> tuple[Frames, list[tuple[int, BadFrameError]]]:
        """The labelled crops of frames ``start`` to ``stop``, and the bad frames
        with their index.
        """
        crops, good, bad = [], [], []
        for i in range(start, stop):
            try:
                crops.append(self.crop(i))
                good.append(i)
            except BadFrameError as error:
                bad.append((i, error))
        some = np.array(good, np.int64)
        center_uvd = self.center_uvd[some]
        half = self.cube_mm[some] / 2
        joints = normalise_joints(self.joints[some], self.camera.unproject(center_uvd), half)
        return Frames.of(np.asarray(crops), joints, center_uvd, self.camera, half, some), bad

    def depth(self, i: int) -> Array:
        """The depth image of frame ``i`` in mm. Raises BadFrameError."""
        path = self.files[i]
        camera = self.camera
        depth = self.read(path)
        if depth.shape != (camera.height, camera.width):
            found = f"{depth.shape[1]} x {depth.shape[0]} pixels, expected {camera.width} x {camera.height}"
            raise BadFrameError(path, WRONG_SIZE, found)
        return depth

    def crop(self, i: int) -> NDArray[np.float32]:
        """The crop of frame ``i``. Raises BadFrameError."""
        path = self.files[i]
        center = self.center_uvd[i]
        is_finite = np.isfinite(center).all() and np.isfinite(self.joints[i]).all()
        if not is_finite or center[2] <= 0:
            raise BadFrameError(path, UNLABELLED)
        depth = self.depth(i)
        try:
            made = crop(depth, center, float(self.cube_mm[i]), self.camera)
        except DataError as error:
            raise BadFrameError(path, OUTSIDE, str(error)) from None
        if not (np.abs(made) < 1).any():
            u, v, d = center
            where = f"within {self.cube_mm[i] / 2:g} mm of u {u:.0f}, v {v:.0f}, {d:.0f} mm"
            raise BadFrameError(path, EMPTY, where)
        return made

    def recipe(self, start: int, rows: int) -> dict[str, object]:
        """The recipe of the crops of ``rows`` frames from ``start`` on, with the names and sizes
        of their images.
        """
        stop = start + rows
        digest = hashlib.sha256()
        for array in (self.center_uvd, self.joints, self.cube_mm):
            digest.update(np.ascontiguousarray(array[start:stop], dtype="<f8").tobytes())
        for path in self.files[start:stop]:
            try:
                size = path.stat().st_size
            except OSError:
                size = -1
            digest.update(f"{path.parent.name}/{path.name} {size}\n".encode())
        return {
            "version": 1,
            "made_from": self.made_from,
            "split": self.split,
            "camera": self.camera.name,
            "centre": self.centre,
            "sha256": digest.hexdigest(),
        }


def check_frames(
    root: Path,
    folder: Path,
    holds: str,
    read: Callable[[], PublishedFrames],
    whole: Callable[[int], list[Flaw]],
) -> tuple[list[str], list[Flaw]]:
    """The content of a split, and its errors, one line each.

    folder  of the split, below ``root``, which ``holds`` something
    read    reads the split
    whole   gives the errors of its number of frames
    """
    if not root.is_dir():
        return [], [Flaw(f"{root}: no such folder")]
    if not folder.is_dir():
        name = str(folder.relative_to(root))
        found = some_of(sorted(names_in(root))) or "nothing"
        return [], [Flaw(f"{root}: no folder {name!r}, which holds {holds}; found {found}")]
    try:
        frames = read()
    except DataError as error:
        return [f"{folder}: no readable labels"], [Flaw(str(error))]
    names = {parent: names_in(parent) for parent in {path.parent for path in frames.files}}
    missing = [path for path in frames.files if path.name not in names[path.parent]]
    count = len(frames)
    flaws = whole(count)
    if missing:
        text = f"{folder}: {len(missing)} of {count} depth frames are missing, the first is {missing[0]}"
        if len(missing) == count:
            found = some_of(sorted(names[missing[0].parent])) or "nothing"
            text += f"; found {found}"
        flaws.append(Flaw(text, fatal=len(missing) == count))
    else:
        try:
            frames.depth(0)
        except BadFrameError as error:  # another size than the camera's is that of all frames
            flaws.append(Flaw(str(error), fatal=error.kind == WRONG_SIZE))
    return [
        f"{folder}: {count} labelled frames, {count - len(missing)} of their depth frames"
    ], flaws


def statistics(frames: PublishedFrames, index: Sequence[int]) -> str:
    """The centre and cube of the frames ``index``, and the share of frames with a joint
    outside, in a line.
    """
    few = np.asarray(index)
    offset = frames.joints[few] - frames.camera.unproject(frames.center_uvd[few])[:, None]
    cubes, counts = np.unique(frames.cube_mm[few].round(3), return_counts=True)
    outside = np.abs(offset) > frames.cube_mm[few, None, None] / 2
    clipped = outside.any(axis=(1, 2)).mean()
    cube = " and ".join(f"{c:g} mm ({n} frames)" for c, n in zip(cubes, counts))
    if len(cubes) == 1:
        cube = f"{cubes[0]:g} mm"
    return (
        f"crops about the {frames.centre}, cube {cube}; {clipped:.1%} of the frames have a joint outside the cube, "
        "which is clipped"
    )


def read_centers(path: Path, frames: int) -> tuple[Array, str]:
    """Crop centres (frames, 3) from a text file with ``u v d`` in each line, and their description.

    Raises DataError.
    """
    text = files.read_text(path, "the centres")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # NumPy's, for empty texts
        try:
            found = np.loadtxt(text.replace(",", " ").splitlines(), ndmin=2)
        except ValueError as error:
            raise DataError(
                f"{path}: cannot read the centres: {reason_of(error)}; expected u v d for each frame, in "
                "lines of a text"
            ) from None
    if found.shape != (frames, 3):
        raise DataError(
            f"{path}: found centres of shape {found.shape}, expected ({frames}, 3): u v d for each frame"
        )
    return found, f"centres of {path.name}"


# ---------------------------------------------------------------------------------------- the files

_FRAMES_PER_TASK = 16  # frames that a thread crops at a time


class PreparedSplit:
    """One split in a folder.

    frames   to prepare
    parts    the HDF5 files; ``missing`` are those to be written, all if ``force``
    list     the text file that names them: SPLIT.txt
    bad      the text file that names the bad frames, if there are any: bad_SPLIT.txt
    index    after ``write``: the numbers of the good frames; ``made`` of them are new
    kinds    likewise: the kind of each bad frame

    Raises DataError where data of another source would be replaced.
    """

    def __init__(self, frames: PublishedFrames, out: Path, force: bool = False) -> None:
        self.frames = frames
        self.parts = parts.parts_of(out, frames.split, len(frames), frames.made_from, frames.recipe)
        self.list, self.bad = out / f"{frames.split}.txt", out / f"bad_{frames.split}.txt"
        self.missing = parts.missing_of(self.parts, [self.list], force)
        self.index: list[int] = []
        self.made = 0
        self.kinds: list[str] = []

    def write(
        self,
        workers: int,
        advance: Callable[[int], None],
        on_bad: Callable[[int, BadFrameError], None],
    ) -> None:
        """Write the missing parts, and name the bad frames.

        workers  number of threads
        advance  is called with the number of further frames
        on_bad   is called for every bad frame with its index, for those of parts that
                 were kept, too

        An exception of ``advance`` or ``on_bad`` ends the run and keeps whole parts only.
        """
        named: list[str] = []

        def report(i: int, error: BadFrameError) -> None:
            on_bad(i, error)
            self.kinds.append(error.kind)
            named.append(f"frame {i}: {error}\n")

        if self.missing:
            self.list.unlink(missing_ok=True)  # no list may name files of two kinds
        pool = ThreadPoolExecutor(workers, "prepare")
        try:
            for part in self.parts:
                if part in self.missing:
                    index = self._write_part(part, pool, advance, report)
                    self.made += len(index)
                else:
                    index = self._read_part(part, report)
                self.index += index
        finally:
            pool.shutdown(cancel_futures=True)
        if named:
            atomic.replace_text(self.bad, "".join(named))
        else:
            self.bad.unlink(missing_ok=True)

    def _read_part(self, part: Part, on_bad: Callable[[int, BadFrameError], None]) -> list[int]:
        """The numbers of the frames of a part that was kept."""
        with hdf5.opened(part.path, "the data") as file:
            index: list[int] = file["index"][...].tolist()
            bad = json.loads(file.attrs["bad"])
        for kind, left_out in bad.items():
            for i in left_out:
                on_bad(i, BadFrameError(self.frames.files[i], kind))
        return index

    def _write_part(
        self,
        part: Part,
        pool: ThreadPoolExecutor,
        advance: Callable[[int], None],
        on_bad: Callable[[int, BadFrameError], None],
    ) -> list[int]:
        """Write a part; returns the numbers of its frames."""
        frames = self.frames
        index: list[int] = []
        bad: dict[str, list[int]] = {}
        firsts = range(part.start, part.start + part.rows, _FRAMES_PER_TASK)
        stops = [min(first + _FRAMES_PER_TASK, part.start + part.rows) for first in firsts]
        pieces = []
        for first, stop, (good, failed) in zip(
            firsts, stops, pool.map(frames.crops, firsts, stops)
        ):
            for i, error in failed:
                bad.setdefault(error.kind, []).append(i)
                on_bad(i, error)
            index.extend(good.index.tolist())
            pieces.append(good.arrays())
            advance(stop - first)
        description = (
            f"{frames.made_from} {frames.split} frames; crops {SIZE} x {SIZE} in [-1, 1] about {frames.centre}, "
            "joints in half-cubes from there (camera axes, x right, y up, z away); lengths in mm."
        )
        # "bad": the frames that were left out
        write_part(part, len(index), pieces, {"description": description, "bad": json.dumps(bad)})
        return index

    def write_list(self) -> None:
        """Write the list of the parts that have frames. Raises DataError if none has."""
        if not self.index:
            folder = self.frames.files[0].parent
            split = self.frames.split
            raise DataError(f"{folder}: none of the {len(self.frames)} {split} frames can be used")
        used = {i // parts.FRAMES_PER_FILE for i in self.index}
        # HDF5Data rejects files without rows
        some = [part.path for n, part in enumerate(self.parts) if n in used]
        atomic.replace_text(self.list, parts.list_text(some))

    def report(self) -> str:
        """The result of the preparation, in two lines."""
        counts = ", ".join(f"{count} {kind}" for kind, count in sorted(Counter(self.kinds).items()))
        bad = f", {len(self.kinds)} bad frames left out: {counts}" if counts else ", none bad"
        split = self.frames.split
        head = f"{split}: {len(self.index)} frames ({self.frames.made_from}){bad}"
        return f"{head}\n{split}: {statistics(self.frames, self.index)}"
