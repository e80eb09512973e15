"""Recordings in one file, read by a library that may fail at any frame."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from handpose.frames.raw import Calibration
from handpose.frames.recording import DepthFrame, Recording
from netlib.errors import DataError, NetlibError, reason_of, system_error_of

MAX_DISTANCE_BACK = 1.0  # s; a larger step back means that the clock was set


class Contained(Recording):
    """Frames until the end of the file, or of its intact part. Every iteration opens the file again."""

    def __init__(self, path: Path, calibration: Calibration, count: int | None = None) -> None:
        self.name = str(path)
        self.camera, self.unit_mm, self.rate, self.count = (
            calibration.camera,
            calibration.unit_mm,
            calibration.rate,
            count,
        )
        self.remarks = self._assumed = calibration.remarks
        self._path, self._decode = path, calibration.decoder(self.name)

    @abstractmethod
    def _stored(self) -> Iterator[tuple[float, NDArray[Any]]]:
        """Seconds by the source's clock, and stored values, frame by frame.

        Raises DataError for invalid frames; any exception of the library means that the file is damaged there.
        """

    def __iter__(self) -> Iterator[DepthFrame]:
        self.cut, self.remarks = "", self._assumed
        clock = Clock(self.name)
        number = -1
        try:
            for number, (time, raw) in enumerate(self._stored()):
                seconds = clock(time)
                if seconds is not None:
                    yield DepthFrame(number, seconds, self._decode(raw, f"{self.name}: frame {number}"))
        except NetlibError:
            raise
        except Exception as error:  # for a damaged file a library may raise any exception
            if system := system_error_of(error):
                raise DataError(f"{self.name}: cannot read the frames: {reason_of(system)}") from error
            if number < 0:
                raise DataError(f"{self.name}: not one frame can be read: {reason_of(error)}") from error
            self.cut = f"damaged or cut after frame {number}: {reason_of(error)}"
        if clock.late:
            self.remarks += (f"frames left out because they are not later than the one before: {clock.late}",)


class Clock:
    """Seconds since the first frame; raises DataError where the clock was set back or forward.

    late  number of frames that were not later than the one before them
    """

    def __init__(self, where: str) -> None:
        self.late = 0
        self._where = where
        self._first: float | None = None
        self._last = 0.0

    def __call__(self, time: float) -> float | None:
        """The time of a frame; None if it is not later than the one before."""
        if self._first is None:
            self._first = self._last = time
            return 0.0
        if time < self._last - MAX_DISTANCE_BACK:
            raise DataError(f"{self._where}: the clock goes back from {self._last:.3f} s to {time:.3f} s; "
                            "expected one recording")
        if time - self._first <= self._last - self._first:
            self.late += 1
            return None
        self._last = time
        return time - self._first
