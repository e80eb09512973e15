"""Videos that browsers play: H.264 in .mp4, each image at its own time.

Needs PyAV (extra ``video``).

with VideoFile(Path("track.mp4")) as video:
    video.write(image, time)     # (height, width, 3), OpenCV's colour order; s
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from fractions import Fraction
from pathlib import Path
from typing import Any

import cv2

from handpose.output.drawing.strokes import Image
from netlib.errors import DataError, NetlibError
from netlib.files import atomic

TICKS_PER_S = 60000  # exact for 30 and 29.97 frames/s
RATES = (0.1, 1000.0)  # range of images per second that players support
MAX_SECONDS = 1e8
# With their options; the first that PyAV was built with is taken. Without B-frames times begin at 0
# for every player.
ENCODERS = {"libx264": {"preset": "veryfast", "crf": "20", "bf": "0"}, "libopenh264": {"b": "8M"}}
BT709, LIMITED = 1, 1  # FFmpeg's constants for this colour standard and its range 16 to 235


class VideoFile:
    """Writes a video; the complete file appears at the end of the block.

    After an exception or Ctrl-C in the block it has the images so far, unless they could not all be
    written: then an old file is kept. Without an image there is no file.

    path  ends in ".mp4"
    rate  images per second: the duration of the last one, at most 10 s; all others last
          until the next

    Raises NetlibError without PyAV or its encoders of H.264, and for another file extension.
    """

    def __init__(self, path: Path, rate: float = 30.0) -> None:
        if path.suffix.lower() != ".mp4":
            raise NetlibError(f"{path}: a video is written as .mp4; expected such a name")
        self.path = path
        self.rate = min(max(rate, RATES[0]), RATES[1])
        try:
            import av  # here, because it is an extra
        except ImportError as error:
            raise NetlibError("PyAV is missing: pip install av") from error
        self._av: Any = av
        self._encoder = next((name for name in ENCODERS if name in self._av.codecs_available), "")
        if not self._encoder:
            raise NetlibError(
                f"{path}: PyAV has no encoder of H.264 here; expected {' or '.join(ENCODERS)}, as in the "
                "wheels of PyPI: pip install av"
            )
        self._stack = contextlib.ExitStack()
        self._file: Any = None
        self._stream: Any = None
        self._failed = False
        self._first = self._last = 0.0

    def __enter__(self) -> VideoFile:
        return self

    def write(self, image: Image, time: float) -> None:
        """Write an image at a time in s after all others, all of one size; the video begins at
        the first one.

        Images of odd sizes get another row or column. Raises DataError for a time that does not
        ascend, OSError.
        """
        if self._stream is None:
            self._begin(image, time)
        elif not 1 <= (time - self._last) * TICKS_PER_S <= MAX_SECONDS * TICKS_PER_S:
            raise DataError(
                f"{self.path}: a picture at {time:g} s after one at {self._last:g} s; expected a later "
                f"one, by 1/{TICKS_PER_S} s at least and {MAX_SECONDS:g} s at most"
            )
        even = cv2.copyMakeBorder(
            image, 0, image.shape[0] % 2, 0, image.shape[1] % 2, cv2.BORDER_REPLICATE
        )
        with self._refusals():
            frame = self._av.VideoFrame.from_ndarray(even, format="bgr24")
            frame = frame.reformat(format="yuv420p", dst_colorspace="ITU709")
            frame.pts = int((time - self._first) * TICKS_PER_S + 0.5)
            frame.time_base = Fraction(1, TICKS_PER_S)
            self._mux(frame)
        self._last = time

    def __exit__(self, *error: object) -> None:
        with self._stack, atomic.error_names(self.path):
            # reported before; a video without some of its images must not replace an old one
            if self._failed:
                with contextlib.suppress(self._av.FFmpegError):
                    self._file.close()
            elif self._stream is not None:
                with self._refusals():
                    self._mux(None)
                    self._file.close()
                atomic.commit(self._fresh, self.path)

    def _begin(self, image: Image, time: float) -> None:
        """Open the file and its stream; the first image determines the size."""
        with contextlib.ExitStack() as stack, atomic.error_names(self.path), self._refusals():
            atomic.require_regular_file(self.path)
            self._fresh = stack.enter_context(atomic.temporary(self.path))
            self._file = self._av.open(
                str(self._fresh), "w", format="mp4", options={"movflags": "+faststart"}
            )
            rate = Fraction(self.rate).limit_denominator(1000)
            stream = self._file.add_stream(
                self._encoder, rate=rate, options=ENCODERS[self._encoder]
            )
            self._stack = stack.pop_all()
        self._first = time
        stream.height, stream.width = (pixels + pixels % 2 for pixels in image.shape[:2])
        stream.pix_fmt = "yuv420p"
        stream.time_base = Fraction(1, TICKS_PER_S)
        coder = stream.codec_context
        coder.time_base = Fraction(1, TICKS_PER_S)
        coder.colorspace = coder.color_primaries = coder.color_trc = BT709
        coder.color_range = LIMITED
        self._stream = stream

    def _mux(self, frame: Any) -> None:
        """Encode a frame, or flush the encoder, and write its output."""
        for packet in self._stream.encode(frame):
            packet.duration = round(TICKS_PER_S / self.rate)  # the duration of the last image
            self._file.mux(packet)

    @contextlib.contextmanager
    def _refusals(self) -> Iterator[None]:
        """Turn FFmpeg's errors into OSErrors that name the file."""
        try:
            yield
        except self._av.FFmpegError as error:
            self._failed = True
            raise OSError(error.errno, error.strerror, str(self.path)) from error
