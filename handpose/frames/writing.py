"""Recordings that can be replayed: a folder, or one .npz, by the name's ending.

path = Path("take.npz")
with RecordingWriter(path, recording.camera, recording.unit_mm, recording.rate) as writer:
    for frame in recording:
        writer.write(frame)

In a folder, a frame's name is its time, as ``000000033333us.png``, and camera.json has the
parameters. The .npz has the arrays depth (frames, height, width) uint16, time (frames,) s, and
camera as JSON.
"""

from __future__ import annotations

import contextlib
import math
import shutil
import zipfile
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
from numpy.lib import format as npy
from numpy.typing import NDArray

from handpose.frames import camera_file
from handpose.frames.cameras import Camera
from handpose.frames.formats import BAGS, CONVERTED, OF_ONE_FRAME
from handpose.frames.recording import CameraInfo, DepthFrame, stored
from netlib import files
from netlib.errors import DataError, NetlibError
from netlib.files import atomic
from netlib.files.paths import exists, names_in

FASTEST = 1  # level of compression: a minute of frames takes seconds
MICRO = 10**6


class RecordingWriter:
    """Writes a recording that exists after the block, also if an exception or Ctrl-C ends it.

    On a full disk a folder keeps all frames so far; FILE.npz, which is written at the
    end, keeps none.

    path     a new or empty folder, or a new FILE.npz
    camera   of the frames, with their size; the frames have no distortion
    unit_mm  depth of a stored value of 1: depths are rounded to it, and must fit into 16 bits
    rate     frames per second, if known; every frame keeps its own time

    Raises NetlibError for an invalid path, DataError for frames that cannot be stored, OSError.
    """

    def __init__(
        self, path: str | Path, camera: Camera, unit_mm: float, rate: float | None = None
    ) -> None:
        path = Path(path)
        suffix = path.suffix.lower()
        self._kind = _Stack if suffix in (*OF_ONE_FRAME, *CONVERTED, *BAGS) else _Folder
        if self._kind is _Stack and suffix != ".npz":
            raise NetlibError(f"{path}: cannot write {suffix}; expected a folder or FILE.npz")
        refuse_existing(path)
        self.path, self.camera, self.unit_mm = path, camera, unit_mm
        self.count = 0
        self._rate = rate
        self._last = -1  # microseconds, the time of the last frame

    def __enter__(self) -> RecordingWriter:
        self._writer = self._kind(
            self.path, CameraInfo(self.camera, unit_mm=self.unit_mm, rate=self._rate)
        )
        return self

    def write(self, frame: DepthFrame) -> None:
        """Add a frame; times must ascend, in microseconds."""
        where = f"{self.path}: frame {frame.number}"
        micro = round(frame.time * MICRO) if math.isfinite(frame.time) else -1
        if frame.depth.shape != (self.camera.height, self.camera.width):
            raise DataError(
                f"{where} has the shape {frame.depth.shape}, expected "
                f"{(self.camera.height, self.camera.width)}"
            )
        if micro <= self._last:
            raise DataError(f"{where}: at {frame.time:.6f} s, which is not after the frame before")
        self._writer.write(frame.time, stored(frame.depth, self.unit_mm, where))
        self._last = micro
        self.count += 1

    def __exit__(self, *error: object) -> None:
        self._writer.close()


def refuse_existing(path: Path) -> None:
    """Raise NetlibError for a file, and for a folder that is not empty."""
    if names_in(path) if path.is_dir() else exists(path):
        raise NetlibError(f"{path}: is there already; name a new one or remove it")


class _Folder:
    """Writes each frame at once, completely or not at all; times are rounded to microseconds.

    The folder is made for the first frame, with the parameters ``given`` in camera.json. Raises
    NetlibError, OSError.
    """

    def __init__(self, path: Path, given: CameraInfo) -> None:
        self._path, self._given, self._has_frames = path, given, False

    def write(self, time: float, values: NDArray[np.uint16]) -> None:
        """Add a frame."""
        content = cv2.imencode(".png", values)[1].tobytes()
        if not self._has_frames:
            with atomic.error_names(self._path):
                refuse_existing(self._path)  # of another program meanwhile
                files.make_folder(self._path)
                camera_file.write(self._path / camera_file.NAME, self._given)
        name = f"{round(time * MICRO):012d}us.png"
        atomic.replace(self._path / name, lambda fresh: fresh.write_bytes(content), sync=False)
        self._has_frames = True

    def close(self) -> None:
        """Sync the names to the disk."""
        if self._has_frames:
            atomic.sync_directory(self._path)


class _Stack:
    """Keeps frames in a hidden file next to ``path``, and writes ``path`` from them at the end, if
    there are any.

    Both need disk space. If there is not enough for the second, the frames are lost.
    Raises OSError.
    """

    def __init__(self, path: Path, given: CameraInfo) -> None:
        self._path = path
        self._given = given
        self._times: list[float] = []
        with contextlib.ExitStack() as stack, atomic.error_names(path):
            files.make_folder(path.parent)
            self._kept = stack.enter_context(
                stack.enter_context(atomic.temporary(path)).open("w+b")
            )
            self._stack = stack.pop_all()

    def write(self, time: float, values: NDArray[np.uint16]) -> None:
        """Add a frame. Raises OSError."""
        with atomic.error_names(self._path):
            self._kept.write(values.astype("<u2").tobytes())
        self._times.append(time)
        self._size = values.shape

    def close(self) -> None:
        """Make the file of all whole frames."""
        with atomic.error_names(self._path), self._stack:
            if self._times:
                atomic.replace(self._path, self._fill)

    def _fill(self, fresh: Path) -> None:
        shape = (len(self._times), *self._size)
        said = camera_file.to_text(replace(self._given, time_unit="s"))
        with zipfile.ZipFile(fresh, "w", zipfile.ZIP_DEFLATED, compresslevel=FASTEST) as archive:
            for name, small in (("time", np.array(self._times)), ("camera", np.array(said))):
                with archive.open(f"{name}.npy", "w") as out:
                    npy.write_array(out, small, allow_pickle=False)
            with archive.open("depth.npy", "w", force_zip64=True) as out:
                npy.write_array_header_1_0(
                    out, {"descr": "<u2", "fortran_order": False, "shape": shape}
                )
                # without an incomplete last frame
                self._kept.truncate(2 * shape[0] * shape[1] * shape[2])
                self._kept.seek(0)
                shutil.copyfileobj(self._kept, out, 1 << 24)
