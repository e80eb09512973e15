"""Recordings that can be replayed: a folder, one .npz, or a lossless video, by the name's ending.

with RecordingWriter(Path("take.npz"), recording.camera, recording.unit_mm, recording.rate) as writer:
    for frame in recording:
        writer.write(frame)
"""

from __future__ import annotations

import contextlib
from pathlib import Path
from types import TracebackType
from typing import Protocol

from handpose.facts.cameras import Camera
from handpose.sources.folder_writer import FolderWriter
from handpose.sources.opening import BAGS, PICTURES, STACKS, VIDEOS
from handpose.sources.recording import DepthFrame
from handpose.sources.stack_writer import StackWriter
from netlib import files
from netlib.errors import DataError, NetlibError
from netlib.files import atomic


class _Writer(Protocol):
    def write(self, frame: DepthFrame) -> None: ...
    def discard(self) -> None: ...


class RecordingWriter:
    """Writes a recording that exists after the block, also if an exception or Ctrl-C ends it.

    On a full disk a folder keeps all frames so far, FILE.mkv all but the last seconds, unless it replaces an old one,
    and FILE.npz, which is written at the end, none: an old file is kept.

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
            from handpose.sources.video_writer import VideoWriter

            with atomic.error_names(self.path):
                files.make_folder(self.path.parent)
            self._writer = self._stack.enter_context(VideoWriter(*arguments, self._whole))
        return self

    def write(self, frame: DepthFrame) -> None:
        """Add a frame; times must ascend."""
        if frame.depth.shape != (self.camera.height, self.camera.width):
            raise DataError(f"{self.path}: frame {frame.number} has the shape {frame.depth.shape}, expected "
                            f"{(self.camera.height, self.camera.width)}")  # fmt: skip
        self._writer.write(frame)
        self.count += 1

    def discard(self) -> None:
        """Drop the frames that were written: after the block there is the old recording, or none."""
        self._writer.discard()

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, where: TracebackType | None
    ) -> None:
        self._stack.__exit__(kind, error, where)
