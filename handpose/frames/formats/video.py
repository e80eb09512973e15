"""Lossless 16-bit depth videos: FFV1 in Matroska, and Azure Kinect's files.

In files of VideoWriter every value is unchanged, and the camera, its unit and rate are in the tag CAMERA in the format
of camera.json. Matroska's clock, as FFmpeg writes it, ticks in milliseconds, so times are exact to 0.5 ms.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from handpose.frames import camera_file
from handpose.frames.formats import azure_kinect, ffmpeg
from handpose.frames.formats.contained import Contained
from handpose.frames.formats.video_writer import TAG
from handpose.frames.raw import Calibration, calibration_of
from handpose.frames.recording import CameraInfo, Recording
from netlib.errors import DataError
from netlib.files import pictures

LOSSLESS = ("ffv1", "rawvideo", "png", "ffvhuff", "tiff")
GRAY = re.compile(r"gray(9|10|12|14|16)(le|be)")
EXPECTED = "depth does not survive that; expected FFV1 of 16 bits (ffmpeg -c:v ffv1 -pix_fmt gray16le)"


def open_video(path: Path, given: CameraInfo) -> Recording:
    """The depth of a video. Raises DataError, and NetlibError without PyAV."""
    with ffmpeg.opened(path) as container:
        azure = azure_kinect.is_recording(container)
        stream = azure_kinect.depth_track(container, str(path)) if azure else _only_stream(container, path)
        dtype = _dtype(stream, str(path))
        own = azure_kinect.given(container, stream, str(path)) if azure else _own(container, stream, path)
        context = stream.codec_context
        if context.width * context.height > pictures.MAX_PIXELS:
            raise DataError(f"{path}: {context.width} x {context.height} pixels; expected those of a depth camera")
        calibration = calibration_of(
            given, own, camera_file.next_to(path), (context.height, context.width), dtype, str(path)
        )
        return _Video(path, calibration, stream.index, dtype)


class _Video(Contained):
    """One stream of a container."""

    def __init__(self, path: Path, calibration: Calibration, stream: int, dtype: np.dtype[Any]) -> None:
        super().__init__(path, calibration)
        self._stream, self._dtype = stream, dtype

    def _stored(self) -> Iterator[tuple[float, NDArray[Any]]]:
        with ffmpeg.opened(self._path) as container:
            stream = container.streams[self._stream]
            for frame in self._frames(container, stream):
                if frame.format.name != stream.codec_context.format.name:
                    raise ValueError(f"the frame after it has {frame.format.name} pixels")
                if frame.pts is None:
                    raise DataError(f"{self.name}: frames without time stamps; expected some (Matroska has them)")
                yield float(frame.pts * frame.time_base), _values(frame, self._dtype)
        if missing := ffmpeg.missing(self._path):
            raise EOFError(missing)

    def _frames(self, container: Any, stream: Any) -> Iterator[Any]:
        """The decoded frames. If the file ends before they do, the error says how much of it is missing, if known."""
        try:
            yield from ffmpeg.frames(container, stream)
        except EOFError as error:
            raise EOFError(ffmpeg.missing(self._path) or str(error)) from None


def _only_stream(container: Any, path: Path) -> Any:
    found = list(container.streams.video)
    if len(found) != 1:
        raise DataError(f"{path}: {len(found) or 'no'} video streams; expected one, of depth")
    return found[0]


def _dtype(stream: Any, where: str) -> np.dtype[Any]:
    """The type of the values of a lossless depth stream. Raises DataError for other streams."""
    context = stream.codec_context
    codec, pixels = (context.name, context.format.name) if context is not None and context.format else ("unknown", "no")
    gray = GRAY.fullmatch(pixels)
    if codec not in LOSSLESS:
        raise DataError(f"{where}: {codec} video ({pixels}), which is lossy: {EXPECTED}")
    if gray is None:
        raise DataError(f"{where}: {codec} video of {pixels} pixels, not 16-bit grey: {EXPECTED}")
    return np.dtype("<u2" if gray[2] == "le" else ">u2")


def _own(container: Any, stream: Any, path: Path) -> CameraInfo:
    """The parameters written by VideoWriter, or the stream's rate."""
    tags = {key.upper(): value for key, value in container.metadata.items()}
    if TAG in tags:
        return camera_file.parse(tags[TAG], f"{path}: tag {TAG}")
    return CameraInfo(rate=float(stream.average_rate) if stream.average_rate else None)


def _values(frame: Any, dtype: np.dtype[Any]) -> NDArray[Any]:
    """The stored values (height, width); rows are padded in memory."""
    plane = frame.planes[0]
    rows = np.frombuffer(plane, dtype).reshape(-1, plane.line_size // 2)
    return rows[: frame.height, : frame.width]
