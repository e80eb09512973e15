"""From the annotated frames of a published data set to the rows of its files.

    depth       (n, 1, 128, 128) float32  the crop in [-1, 1]; handpose/crop.py
    joint       (n, 3 K) float32          joints x, y, z in half-cubes from the crop centre, clipped to [-1, 1]
    center      (n, 3) float32            crop centre in mm, camera axes
    center_uvd  (n, 3) float32            the same in px, px, mm
    index       (n,) int64                0-based number of the frame in its split
    half_cube   (n,) float32              mm

A frame that cannot be used is named, counted and left out.
"""

from __future__ import annotations

import collections
import contextlib
import hashlib
import json
import os
import zlib
from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import cv2
import h5py
import numpy as np
from numpy.typing import NDArray

from handpose.camera import Camera
from handpose.crop import SIZE, crop, normalise_joints
from handpose.dataset import Array, Columns, Part, is_whole, write_part
from netlib.errors import DataError, reason_of

# What can be wrong with a frame, in the words of the reports.
MISSING = "no such file"
DAMAGED = "truncated, damaged or no PNG"
WRONG_SIZE = "wrong size or type of image"
UNLABELLED = "a joint or the centre is not a number, or not before the camera"
OUTSIDE = "the cube lies outside the image"
EMPTY = "no depth around the hand"

_CHUNK = 16  # frames that a thread turns into rows at a time
_AHEAD = 8  # chunks ahead of the writer, for each thread


class BadFrameError(DataError):
    """A frame that cannot be used; ``kind`` is one of the constants above."""

    def __init__(self, path: object, kind: str, detail: str = "") -> None:
        super().__init__(f"{path}: {kind}{detail and f' ({detail})'}")
        self.kind = kind


@dataclass(frozen=True)
class Annotated:
    """The annotated frames of one split, as published."""

    split: str  # "train" or "test"
    files: Sequence[Path]  # depth images, N
    center_uvd: Array  # (N, 3) middles of the cubes: px, px, mm
    joints: Array  # (N, K, 3) mm, camera axes
    cube_mm: Array  # (N,) edges of the cubes
    camera: Camera
    read: Callable[[Path], Array]  # depth image in mm; raises BadFrameError
    made_from: str
    centre: str  # what the centres are, in words

    def __len__(self) -> int:
        return len(self.files)

    def columns(self) -> dict[str, Array]:
        """Arrays without rows, of the shapes and types of a part's."""
        f4 = np.float32
        shapes = {"depth": (1, SIZE, SIZE), "joint": (self.joints[0].size,), "center": (3,), "center_uvd": (3,)}
        return {
            **{name: np.zeros((0, *shape), f4) for name, shape in shapes.items()},
            "index": np.zeros(0, np.int64),
            "half_cube": np.zeros(0, f4),
        }

    def rows(self, start: int, stop: int) -> tuple[dict[str, Array], list[tuple[int, BadFrameError]]]:
        """The rows of frames ``start`` to ``stop``, without the bad ones, which come beside with their index."""
        crops, good, bad = [], [], []
        for i in range(start, stop):
            try:
                crops.append(self.crop(i))
                good.append(i)
            except BadFrameError as error:
                bad.append((i, error))
        some = np.array(good, np.int64)
        center = self.camera.unproject(self.center_uvd[some])
        half = np.asarray(self.cube_mm[some] / 2)
        joints = normalise_joints(self.joints[some], center, half, clip=True)
        arrays: dict[str, Array] = {
            "depth": np.asarray(crops, np.float32).reshape(-1, 1, SIZE, SIZE),
            "joint": joints.reshape(len(good), self.joints[0].size).astype(np.float32),
            "center": center.astype(np.float32),
            "center_uvd": self.center_uvd[some].astype(np.float32),
            "index": some,
            "half_cube": half.astype(np.float32),
        }
        return arrays, bad

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

    def recipe(self, start: int, stop: int) -> str:
        """All that the rows of frames ``start`` to ``stop`` depend on; of the images their names and sizes only."""
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


@dataclass
class Outcome:
    """What became of the frames of a split."""

    parts: list[Part]
    index: list[int] = field(default_factory=list)  # of the good frames
    bad: dict[int, str] = field(default_factory=dict)  # kind by index
    made: int = 0  # good frames that were not there before


def parts_of(frames: Annotated, out: Path, frames_per_file: int) -> list[Part]:
    """The files that a split becomes."""
    parts = []
    for i, start in enumerate(range(0, len(frames), frames_per_file)):
        stop = min(start + frames_per_file, len(frames))
        parts.append(Part(out / f"{frames.split}_{i:03d}.h5", stop - start, frames.recipe(start, stop)))
    return parts


def write_annotated(
    frames: Annotated,
    parts: Sequence[Part],
    workers: int,
    advance: Callable[[int], None],
    on_bad: Callable[[int, BadFrameError], None],
    force: bool = False,
) -> Outcome:
    """Write those parts of a split that are not there yet.

    ``advance`` is called with numbers of frames that were dealt with, ``on_bad`` for every bad frame with its
    index (for those of parts that were kept, too); an exception of either ends the run and keeps whole parts only.
    """
    outcome = Outcome(list(parts))
    start = 0
    with ThreadPoolExecutor(workers, "prepare") as pool:
        for part in parts:
            stop = start + part.rows
            if not force and is_whole(part):
                _recall(frames, part, outcome, on_bad)
            else:
                _write_rows(frames, part, start, stop, pool, workers, outcome, advance, on_bad)
            start = stop
    return outcome


def _recall(frames: Annotated, part: Part, outcome: Outcome, on_bad: Callable[[int, BadFrameError], None]) -> None:
    """Take the outcome of a part from its file."""
    with h5py.File(part.path, "r") as file:
        outcome.index += file["index"][...].tolist()
        bad = json.loads(file.attrs["bad"])
    for kind, indices in bad.items():
        for i in indices:
            outcome.bad[i] = kind
            on_bad(i, BadFrameError(frames.files[i], kind))


def _write_rows(
    frames: Annotated,
    part: Part,
    start: int,
    stop: int,
    pool: ThreadPoolExecutor,
    workers: int,
    outcome: Outcome,
    advance: Callable[[int], None],
    on_bad: Callable[[int, BadFrameError], None],
) -> None:
    index: list[int] = []
    bad: dict[int, str] = {}

    def pieces() -> Iterator[Columns]:
        with contextlib.closing(_in_threads(frames, start, stop, pool, workers)) as chunks:
            for count, arrays, failed in chunks:
                for i, error in failed:
                    bad[i] = error.kind
                    on_bad(i, error)
                index.extend(arrays["index"].tolist())
                yield arrays
                advance(count)

    def attributes() -> dict[str, object]:
        kinds: dict[str, list[int]] = {}
        for i, kind in bad.items():
            kinds.setdefault(kind, []).append(i)
        return {
            "made_from": frames.made_from,
            "description": f"{frames.made_from} {frames.split} frames; crops {SIZE} x {SIZE} in [-1, 1] about "
            f"{frames.centre}, joints in half-cubes from there (camera axes, x right, y up, z away); lengths in mm.",
            "bad": json.dumps(kinds),  # frames that were left out
        }

    write_part(part, frames.columns(), pieces(), attributes)
    outcome.index += index
    outcome.bad.update(bad)
    outcome.made += len(index)


def _in_threads(
    frames: Annotated, start: int, stop: int, pool: ThreadPoolExecutor, workers: int
) -> Generator[tuple[int, dict[str, Array], list[tuple[int, BadFrameError]]], None, None]:
    """``frames.rows`` of all chunks, in order, with the number of frames of each; OpenCV lets other threads run."""
    ahead: collections.deque[tuple[int, Future[Any]]] = collections.deque()
    try:
        for first in range(start, stop, _CHUNK):
            last = min(first + _CHUNK, stop)
            ahead.append((last - first, pool.submit(frames.rows, first, last)))
            if len(ahead) > _AHEAD * workers:
                count, future = ahead.popleft()
                yield count, *future.result()
        while ahead:
            count, future = ahead.popleft()
            yield count, *future.result()
    finally:
        for _, future in ahead:
            future.cancel()


def statistics(frames: Annotated, index: Sequence[int]) -> str:
    """Millimetre figures of the frames ``index``, in one line that says about which centre and in which cube."""
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


# ------------------------------------------------------------------------------------------- raw material


def read_png(path: str | Path) -> Array:
    """The pixels of a PNG file as they are, colours in OpenCV's order (blue first). Raises BadFrameError.

    The file is first checked chunk by chunk, because some versions of OpenCV fill up a truncated picture.
    """
    try:
        raw = Path(path).read_bytes()
    except FileNotFoundError:
        raise BadFrameError(path, MISSING) from None
    except OSError as error:
        raise BadFrameError(path, DAMAGED, reason_of(error)) from None
    if not _is_whole_png(raw):
        raise BadFrameError(path, DAMAGED)
    image = cv2.imdecode(np.frombuffer(raw, np.uint8), cv2.IMREAD_UNCHANGED)
    if image is None:
        raise BadFrameError(path, DAMAGED)
    return np.asarray(image)


def _is_whole_png(raw: bytes) -> bool:
    """Are all chunks there, each with the right checksum?"""
    at, view = 8, memoryview(raw)
    if raw[:8] != b"\x89PNG\r\n\x1a\n":
        return False
    while at + 12 <= len(raw):
        end = at + 8 + int.from_bytes(raw[at : at + 4], "big")
        if zlib.crc32(view[at + 4 : end]) != int.from_bytes(raw[end : end + 4], "big"):
            return False
        if raw[at + 4 : at + 8] == b"IEND":
            return True
        at = end + 4
    return False


def read_centers(path: Path, frames: int) -> NDArray[np.float64]:
    """Crop centres (frames, 3) from a text file of ``u v d`` a line, or an .npy or .npz file. Raises DataError.

    In an .npz file the array is called center_uvd, or is the only one.
    """
    try:
        if path.suffix in (".npy", ".npz"):
            loaded = np.load(path, allow_pickle=False)
            if path.suffix == ".npz":
                names = loaded.files
                name = "center_uvd" if "center_uvd" in names else names[0] if len(names) == 1 else ""
                if not name:
                    raise DataError(f"{path}: holds {', '.join(names) or 'nothing'}; expected an array center_uvd")
                loaded = loaded[name]
            found = np.asarray(loaded, dtype=np.float64)
        else:
            lines = path.read_text(encoding="utf-8").split("\n")
            lines = lines[:-1] if lines and not lines[-1].strip() else lines
            found = np.array([_numbers(path, i, line, 3) for i, line in enumerate(lines, 1)]).reshape(-1, 3)
    except (OSError, ValueError, EOFError) as error:
        raise DataError(f"{path}: cannot read the centres: {reason_of(error)}") from None
    if found.shape != (frames, 3):
        raise DataError(f"{path}: found centres of shape {found.shape}, expected ({frames}, 3): u v d for each frame")
    return found


def _numbers(path: Path, line: int, text: str, count: int) -> list[float]:
    """The numbers of a line. Raises DataError."""
    try:
        values = [float(word) for word in text.replace(",", " ").split()]
    except ValueError:
        values = []
    if len(values) != count:
        raise DataError(f"{path}:{line}: expected {count} numbers, found {text.strip()[:60]!r}")
    return values


# -------------------------------------------------------------------------------------------- what is there


@dataclass(frozen=True)
class Problem:
    """Something wrong with a data set, in one line."""

    text: str
    fatal: bool = True  # there is no use in going on


def recognise(root: Path) -> str | None:
    """What a folder seems to hold, in words, or None if it does not look like anything known."""
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
    """A few names in a folder, and those of labels."""
    found = [name for name in ("joint_data.mat", "labels.txt") if (folder / name).is_file()]
    with contextlib.suppress(OSError), os.scandir(folder) as entries:
        found += [entry.name for entry, _ in zip(entries, range(1000))]
    return found
