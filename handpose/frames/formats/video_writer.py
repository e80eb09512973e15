"""Writes depth as a lossless video: FFV1 of 16 bits in Matroska, frame by frame."""

from __future__ import annotations

import contextlib
from fractions import Fraction
from pathlib import Path
from types import TracebackType
from typing import Any

from handpose.frames import camera_file
from handpose.frames.cameras import Camera
from handpose.frames.formats import ffmpeg
from handpose.frames.raw import RATE, stored
from handpose.frames.recording import CameraInfo, DepthFrame
from netlib.errors import DataError
from netlib.files import atomic

TAG = "CAMERA"  # Matroska's tags are in capitals
TICK = Fraction(1, 1000)  # s: FFmpeg writes no Matroska with a finer one
OPTIONS = {"level": "3", "slicecrc": "1", "g": "1"}  # every frame alone, with checksums


class VideoWriter:
    """Writes a video that is complete after the block: with all frames, or those until an exception or Ctrl-C.

        with VideoWriter(path, camera, unit_mm, rate) as video:
            video.write(frame)

    unit_mm  depth of a stored value of 1; depths are rounded to it, and must fit into 16 bits
    rate     frames per second, if known; every frame keeps its own time

    Raises DataError for frames that cannot be written, OSError, and NetlibError without PyAV. Without frames no file is
    written, and an old one is kept. If the disk fails, the old file is kept, or, without one, a truncated file with the
    frames that reached the disk (FFmpeg buffers up to five seconds); with ``whole``, none.
    """

    def __init__(self, path: Path, camera: Camera, unit_mm: float, rate: float | None, whole: bool = False) -> None:
        self._path, self._camera, self._unit, self._rate = path, camera, unit_mm, rate
        self._av = ffmpeg.library()
        self._last: int | None = None
        self._failed, self._whole = False, whole

    def __enter__(self) -> VideoWriter:
        if self._path.exists() and not self._path.is_file():
            raise DataError(f"{self._path}: cannot be written: it is not a file")
        with contextlib.ExitStack() as stack, atomic.error_names(self._path):
            self._fresh = stack.enter_context(atomic.temporary(self._path))
            self._container = self._av.open(str(self._fresh), "w", format="matroska")
            stack.callback(self._container.close)
            self._stream = self._new_stream()
            self._stack = stack.pop_all()
        return self

    def _new_stream(self) -> Any:
        said = CameraInfo(self._camera, None, self._unit, self._rate)
        self._container.metadata[TAG] = camera_file.to_text(said)
        rate = Fraction(self._rate or RATE).limit_denominator(1 << 16)
        stream = self._container.add_stream("ffv1", rate=rate, options=OPTIONS)
        stream.width, stream.height, stream.pix_fmt = self._camera.width, self._camera.height, "gray16le"
        stream.codec_context.thread_count = 1  # no frame waits in the encoder
        stream.codec_context.time_base = TICK
        return stream

    def write(self, frame: DepthFrame) -> None:
        """Append a frame."""
        where = f"{self._path}: frame {frame.number}"
        values = stored(frame.depth, self._unit, where)
        tick = round(frame.time / TICK)
        if self._last is not None and tick <= self._last:
            raise DataError(f"{where}: at {frame.time:.6f} s, less than 1 ms after the frame before; "
                            "a video's clock has no finer ticks")
        picture = self._av.VideoFrame.from_ndarray(values.astype("<u2"), format="gray16le")
        picture.pts, picture.time_base = tick, TICK
        try:
            with atomic.error_names(self._path):
                self._container.mux(self._stream.encode(picture))
        except OSError:
            self._failed = True
            raise
        self._last = tick

    def discard(self) -> None:
        """Drop the frames so far, without writing a file."""
        self._last = None

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, where: TracebackType | None
    ) -> None:
        with atomic.error_names(self._path), self._stack:
            if self._last is None:
                return
            failure = None
            try:
                if not self._failed:
                    self._container.mux(self._stream.encode(None))
                self._container.close()
            except OSError as one:
                failure = one
            cut = self._failed or failure is not None
            if not cut or (not (self._whole or self._path.exists()) and _has_a_frame(self._fresh)):
                atomic.commit(self._fresh, self._path, sync=not cut)
            if failure is not None and not self._failed:  # otherwise it was reported before
                raise failure


def _has_a_frame(path: Path) -> bool:
    """True if the first frame reached the disk."""
    try:
        with ffmpeg.opened(path) as container:
            return next(ffmpeg.frames(container, container.streams.video[0]), None) is not None
    except Exception:  # for a damaged file FFmpeg may raise any exception
        return False
