"""Recordings that can be replayed: a folder, one .npz, or a lossless video, by the name's ending.

with RecordingWriter(Path("take.npz"), recording.camera, recording.unit_mm, recording.rate) as writer:
    for frame in recording:
        writer.write(frame)

The .npz has the arrays depth (frames, height, width) uint16, time (frames,) s, and camera as JSON, as ``stack`` reads.
"""

from __future__ import annotations

import contextlib
import shutil
import zipfile
from pathlib import Path
from types import TracebackType
from typing import Protocol

import numpy as np
from numpy.lib import format as npy

from handpose.frames import camera_file
from handpose.frames.cameras import Camera
from handpose.frames.formats.folder_writer import FolderWriter
from handpose.frames.opening import BAGS, PICTURES, STACKS, VIDEOS
from handpose.frames.raw import stored
from handpose.frames.recording import CameraInfo, DepthFrame
from netlib import files
from netlib.errors import DataError, NetlibError
from netlib.files import atomic

FASTEST = 1  # level of compression: a minute of frames takes seconds


class _Writer(Protocol):
    def write(self, frame: DepthFrame) -> None: ...
    def discard(self) -> None: ...


class RecordingWriter:
    """Writes a recording that exists after the block, also if an exception or Ctrl-C ends it.

    On a full disk a new folder keeps all frames so far, a new FILE.mkv all but the last seconds, and FILE.npz, which is
    written at the end, none. An old recording that was to be replaced is kept instead.

    path     a folder, FILE.npz, or FILE.mkv
    camera   of the frames, with their size; the frames have no distortion
    unit_mm  depth of a stored value of 1: depths are rounded to it, and must fit into 16 bits
    rate     frames per second, if known; every frame keeps its own time
    replace  an existing recording
    whole    keep no incomplete new recording if the disk fails

    Raises NetlibError for an invalid path, DataError for frames that cannot be stored, OSError.
    """

    def __init__(
        self,
        path: Path,
        camera: Camera,
        unit_mm: float,
        rate: float | None = None,
        *,
        replace: bool = False,
        whole: bool = False,
    ) -> None:
        suffix = path.suffix.lower()
        self._is_folder = suffix not in (*STACKS, *VIDEOS, *BAGS, *PICTURES)
        if not self._is_folder and suffix not in (".npz", ".mkv"):
            raise NetlibError(f"{path}: cannot write {suffix}; expected a folder, FILE.npz or FILE.mkv")
        if not self._is_folder and path.exists() and not replace:
            raise NetlibError(f"{path}: is there already; name a new file or replace it by --force")
        self.path, self.camera, self.unit_mm, self.count = path, camera, unit_mm, 0
        self._rate, self._replace, self._whole = rate, replace, whole
        self._stack = contextlib.ExitStack()

    def __enter__(self) -> RecordingWriter:
        arguments = (self.path, self.camera, self.unit_mm, self._rate)
        self._writer: _Writer
        if self._is_folder:
            self._writer = self._stack.enter_context(contextlib.closing(FolderWriter(*arguments, self._replace)))
        elif self.path.suffix.lower() == ".npz":
            self._writer = self._stack.enter_context(contextlib.closing(StackWriter(*arguments)))
        else:
            from handpose.frames.formats.video_writer import VideoWriter

            with atomic.error_names(self.path):
                files.make_folder(self.path.parent)
            self._writer = self._stack.enter_context(VideoWriter(*arguments, self._whole))
        return self

    def write(self, frame: DepthFrame) -> None:
        """Add a frame; times must ascend."""
        if frame.depth.shape != (self.camera.height, self.camera.width):
            raise DataError(f"{self.path}: frame {frame.number} has the shape {frame.depth.shape}, expected "
                            f"{(self.camera.height, self.camera.width)}")
        self._writer.write(frame)
        self.count += 1

    def discard(self) -> None:
        """Drop the frames that were written: after the block there is the old recording, or none."""
        self._writer.discard()

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, where: TracebackType | None
    ) -> None:
        self._stack.__exit__(kind, error, where)


class StackWriter:
    """Keeps frames in a hidden file next to ``path``, and writes ``path`` from them at the end, if there are any.

    Both need disk space. If there is not enough for the second, the frames are lost: there is no file, or the old one.
    Raises OSError.
    """

    def __init__(self, path: Path, camera: Camera, unit_mm: float, rate: float | None) -> None:
        self._path, self._camera, self._unit, self._rate = path, camera, unit_mm, rate
        self._times: list[float] = []
        with contextlib.ExitStack() as stack, atomic.error_names(path):
            files.make_folder(path.parent)
            self._kept = stack.enter_context(stack.enter_context(atomic.temporary(path)).open("w+b"))
            self._stack = stack.pop_all()

    def write(self, frame: DepthFrame) -> None:
        """Add a frame. Raises DataError, OSError."""
        where = f"{self._path}: frame {frame.number}"
        if self._times and frame.time <= self._times[-1]:
            raise DataError(f"{where}: at {frame.time:.6f} s, which is not after the frame before")
        values = stored(frame.depth, self._unit, where)
        with atomic.error_names(self._path):
            self._kept.write(values.astype("<u2").tobytes())
        self._times.append(frame.time)

    def discard(self) -> None:
        """Drop the frames so far, without writing a file."""
        self._times.clear()

    def close(self) -> None:
        """Make the file of all whole frames."""
        with atomic.error_names(self._path), self._stack:
            if self._times:
                atomic.replace(self._path, self._fill)

    def _fill(self, fresh: Path) -> None:
        shape = (len(self._times), self._camera.height, self._camera.width)
        said = camera_file.to_text(CameraInfo(self._camera, unit_mm=self._unit, rate=self._rate, time_unit="s"))
        with zipfile.ZipFile(fresh, "w", zipfile.ZIP_DEFLATED, compresslevel=FASTEST) as archive:
            for name, small in (("time", np.array(self._times)), ("camera", np.array(said))):
                with archive.open(f"{name}.npy", "w") as out:
                    npy.write_array(out, small, allow_pickle=False)
            with archive.open("depth.npy", "w", force_zip64=True) as out:
                npy.write_array_header_1_0(out, {"descr": "<u2", "fortran_order": False, "shape": shape})
                self._kept.truncate(2 * shape[0] * shape[1] * shape[2])  # without an incomplete last frame
                self._kept.seek(0)
                shutil.copyfileobj(self._kept, out, 1 << 24)
