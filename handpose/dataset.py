"""Data sets on disk: from annotated frames to HDF5 files that are each whole or not there at all.

A data set is a few files ("parts") of some thousand frames, and a list that names them, which HDF5Data reads.
A part is laid out by HDF5, filled by plain writes under a temporary name, synced and then renamed. It carries
its *recipe*, a text of all that it depends on: a part with the right recipe is kept, so that a run that was
interrupted goes on where it stopped.

The second half of the module turns the frames of a published data set (``Annotated``) into the rows of a part:

    depth       (n, 1, 128, 128) float32  the crop in [-1, 1]; handpose/crop.py
    joint       (n, 3 K) float32          joints x, y, z in half-cubes from the crop centre, clipped to [-1, 1]
    center      (n, 3) float32            crop centre in mm, camera axes
    center_uvd  (n, 3) float32            the same in px, px, mm
    index       (n,) int64                0-based number of the frame in its split
    half_cube   (n,) float32              mm
"""

from __future__ import annotations

import collections
import contextlib
import errno
import hashlib
import json
import os
import shutil
import signal
import threading
import zlib
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path
from types import FrameType
from typing import Any

import cv2
import h5py
import numpy as np
from numpy.typing import NDArray

from handpose.camera import Camera
from handpose.crop import SIZE, crop, normalise_joints
from netlib.errors import DataError, reason_of

Array = NDArray[Any]
Columns = Mapping[str, Array]  # data sets by name; rows first

_COPY = 64  # rows copied at a time
_PAGE = 1 << 16  # what a file takes beyond its rows, nearly

# ----------------------------------------------------------------------------------------------- parts


@dataclass(frozen=True)
class Part:
    """One file to be."""

    path: Path
    rows: int  # at most
    recipe: str  # all that the file depends on


def attributes(path: Path) -> dict[str, Any] | None:
    """The attributes of an HDF5 file, or None if it is none."""
    try:
        with h5py.File(path, "r") as file:
            return dict(file.attrs)
    except OSError:
        return None


def is_whole(part: Part) -> bool:
    """Is the file there, made by this very recipe?"""
    found = attributes(part.path) if part.path.is_file() else None
    return found is not None and found.get("recipe") == part.recipe


def refuse_foreign(files: Sequence[Path], lists: Sequence[Path], own: Sequence[str]) -> None:
    """Raise DataError if a file to be replaced, or one that a list to be replaced names, is not of ``own`` origin."""
    listed = [Path(line.strip()) for path in lists for line in (text_of(path) or "").splitlines() if line.strip()]
    for path in dict.fromkeys([*files, *listed]):
        if not path.exists():
            continue
        found = attributes(path)
        if found is None:
            raise DataError(f"{path}: not a readable HDF5 file; move it away, choose another --out, or use --force")
        origin = found.get("made_from", "an unknown source")
        if origin not in own:
            raise DataError(
                f"{path}: holds data made from {origin}; choose another --out, or use --force to replace it"
            )


def text_of(path: Path) -> str | None:
    """The text of a file, or None if there is none. Raises DataError."""
    try:
        return path.read_text(encoding="utf-8")
    except FileNotFoundError:
        return None
    except (OSError, UnicodeDecodeError) as error:
        raise DataError(f"{path}: {reason_of(error)}") from None


def list_text(paths: Iterable[Path]) -> str:
    """The text of a list of files."""
    return "".join(f"{path.as_posix()}\n" for path in paths)


def row_bytes(columns: Columns) -> int:
    """Bytes of one row of all data sets."""
    return sum(int(np.prod(a.shape[1:])) * a.dtype.itemsize for a in columns.values())


def check_space(out: Path, parts: Sequence[Part], columns: Columns) -> None:
    """Raise DataError at once rather than after a minute if the disk is too small."""
    replaced = sum(part.path.stat().st_size for part in parts if part.path.is_file())
    check_room(out, sum(part.rows * row_bytes(columns) + _PAGE for part in parts) - replaced)


def check_room(out: Path, need: int) -> None:
    """Raise DataError if a folder's disk has fewer than ``need`` bytes left."""
    free = shutil.disk_usage(out).free
    if need > free:
        raise DataError(f"{out}: needs {need / 1e6:.0f} MB, {free / 1e6:.0f} MB are free")


def write_part(
    part: Part, columns: Columns, pieces: Iterable[Columns], attributes: Callable[[], Mapping[str, object]]
) -> int:
    """Write the rows that ``pieces`` yield; returns their number, at most ``part.rows``.

    ``columns`` are arrays without rows, of the shapes and types of those in ``pieces``; ``attributes`` is asked
    for the attributes of the file once before the pieces, and again after them if they had too few rows.
    """
    written = 0

    def fill(path: Path) -> None:
        nonlocal written
        written = _fill(path, part.rows, columns, pieces, {**attributes(), "recipe": part.recipe})
        if written < part.rows:
            long = path.with_name(f"{path.name}.long.tmp")
            path.replace(long)
            try:
                offsets = _offsets(long)
                with long.open("rb") as file:
                    _fill(path, written, columns, _rows(file, offsets, columns, written),
                          {**attributes(), "recipe": part.recipe})  # fmt: skip
            finally:
                long.unlink(missing_ok=True)

    replace(part.path, fill)
    return written


def _fill(path: Path, rows: int, columns: Columns, pieces: Iterable[Columns], attributes: Mapping[str, object]) -> int:
    """HDF5 lays out the file, plain writes fill it: where HDF5 fails to write, it takes the process with it."""
    with path.open("wb") as file:
        _reserve(file.fileno(), rows * row_bytes(columns) + _PAGE)
    offsets = _lay_out(path, rows, columns, attributes)
    done = 0
    with path.open("r+b") as file:
        _reserve(file.fileno(), path.stat().st_size)
        for piece in pieces:
            count = len(next(iter(piece.values())))
            if not count:
                continue
            for name, array in piece.items():
                file.seek(offsets[name] + done * array[0].nbytes)
                file.write(np.ascontiguousarray(array).data)
            done += count
    return done


def _lay_out(path: Path, rows: int, columns: Columns, attributes: Mapping[str, object]) -> dict[str, int]:
    """Make the file with its data sets still empty; returns where each begins."""
    plist = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
    plist.set_alloc_time(h5py.h5d.ALLOC_TIME_EARLY)
    plist.set_fill_time(h5py.h5d.FILL_TIME_NEVER)
    # Whole pages, so that readers can map the frames into memory.
    with h5py.File(path, "w", alignment_threshold=1 << 16, alignment_interval=4096) as file:
        for name, value in attributes.items():
            file.attrs[name] = value
        for name, array in columns.items():
            file.create_dataset(name, (rows, *array.shape[1:]), array.dtype, dcpl=plist)
    return _offsets(path)


def _offsets(path: Path) -> dict[str, int]:
    with h5py.File(path, "r") as file:
        return {name: file[name].id.get_offset() for name in file}


def _rows(file: Any, offsets: Mapping[str, int], columns: Columns, rows: int) -> Iterator[Columns]:
    """The first ``rows`` rows of an open file, in pieces."""
    for first in range(0, rows, _COPY):
        count = min(_COPY, rows - first)
        piece = {}
        for name, array in columns.items():
            row = int(np.prod(array.shape[1:])) * array.dtype.itemsize
            file.seek(offsets[name] + first * row)
            piece[name] = np.frombuffer(file.read(count * row), array.dtype).reshape(count, *array.shape[1:])
        yield piece


def _reserve(handle: int, size: int) -> None:
    """Take the room on the disk before work goes into filling it."""
    if hasattr(os, "posix_fallocate"):
        try:
            os.posix_fallocate(handle, 0, size)
        except OSError as error:
            if error.errno not in (errno.EINVAL, errno.EOPNOTSUPP):  # some file systems cannot
                raise


def replace(path: Path, fill: Callable[[Path], object], sync: bool = True) -> None:
    """Have ``fill`` write a temporary file, which then takes the place of ``path``, whole or not at all.

    Without ``sync`` that is true of a run that is killed, but not of a machine that loses power.
    """
    temporary = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    try:
        fill(temporary)
        if sync:
            with temporary.open("r+b") as file:
                os.fsync(file.fileno())
        temporary.replace(path)
        if sync and os.name == "posix":  # the new name, too, must reach the disk
            folder = os.open(path.parent, os.O_RDONLY)
            try:
                os.fsync(folder)
            finally:
                os.close(folder)
    finally:
        temporary.unlink(missing_ok=True)


def replace_text(path: Path, text: str) -> None:
    """Write a text file, whole or not at all."""
    replace(path, lambda temporary: temporary.write_text(text, encoding="utf-8"))


class StoppedError(Exception):
    """A signal asked the run to end."""


class Stopper:
    """Within it, the first Ctrl-C or SIGTERM is only noted, to be raised by ``check``; a second one hits at once.

    An exception that the signal itself raised could fall into a place that swallows it.
    """

    signum = 0
    _before: dict[signal.Signals, Any]

    def __enter__(self) -> Stopper:
        self._before = {}
        if threading.current_thread() is threading.main_thread():
            self._before = {number: signal.signal(number, self._note) for number in (signal.SIGINT, signal.SIGTERM)}
        return self

    def __exit__(self, *exception: object) -> None:
        for number, handler in self._before.items():
            signal.signal(number, handler)

    def _note(self, signum: int, frame: FrameType | None) -> None:
        self.signum = signum
        self.__exit__()

    def check(self) -> None:
        """Raise StoppedError if a signal came."""
        if self.signum:
            raise StoppedError


# ---------------------------------------------------------------------------------------- annotated frames

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


def names_in(folder: Path) -> set[str]:
    """The names of all that a folder holds; of what is not there or cannot be read, nothing."""
    with contextlib.suppress(OSError), os.scandir(folder) as entries:
        return {entry.name for entry in entries}
    return set()
