"""Stacks of depth frames in one array: .npy, .npz, .h5.

An .npy file is an array (frames, height, width) of integers of 16 bits or more, or of floating-point numbers. In an
.npz or .h5 file it is called depth; the file may also have

    time             (frames,) s, by any clock; ms, us or ns if time_unit or the steps show that
    fx, fy, u0, v0   px, unit_mm, rate, distortion and all other keys of a camera.json; or its whole text as ``camera``

(all but time are attributes in an .h5). Frames are read one by one, so a stack may exceed the memory.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from handpose.frames import camera_file
from handpose.frames.formats.numpy_files import HEADER, Header, NpzFile, header_of
from handpose.frames.formats.time_units import in_seconds
from handpose.frames.raw import RATE, calibration_of
from handpose.frames.recording import UNKNOWN, CameraInfo, DepthFrame, Recording
from netlib.errors import DataError
from netlib.files import Source, hdf5

OF_ANYTHING = ("name", "model", *camera_file.SIZE)  # ambiguous keys, ignored without fx


def open_stack(path: Path, given: CameraInfo = UNKNOWN) -> Recording:
    """The frames of an .npy, .npz or .h5 file. Raises DataError."""
    kinds: dict[str, type[_Frames]] = {".npy": _Npy, ".npz": _Npz}
    return StackRecording(path, kinds.get(path.suffix.lower(), _Hdf5)(path), given)


class StackRecording(Recording):
    """The frames of an array."""

    def __init__(self, path: Path, frames: _Frames, given: CameraInfo) -> None:
        camera_json = camera_file.next_to(path)
        calibration = calibration_of(given, frames.own, camera_json, frames.shape[1:], frames.dtype, str(path))
        self.name, self.camera, self.unit_mm = str(path), calibration.camera, calibration.unit_mm
        self.count, self.rate, self.remarks = frames.shape[0], calibration.rate, calibration.remarks
        self._times = frames.times
        if frames.times is not None:
            given_unit = given.or_else(frames.own).or_else(camera_json).time_unit
            self._times, how = in_seconds(frames.times, given_unit, calibration.rate or RATE)
            self.remarks += (how,) if how else ()
        elif given.time_unit is not None:
            raise DataError(f"{path}: has no times, so --time-unit has no meaning; expected an array time")
        elif self.count > 1:
            self.rate, remarks = calibration.paced()
            self.remarks += remarks
        self._frames, self._decode = frames, calibration.decoder(self.name)

    def __iter__(self) -> Iterator[DepthFrame]:
        times = self._times
        for number, raw in enumerate(self._frames):
            time = number / (self.rate or 1.0) if times is None else float(times[number] - times[0])
            yield DepthFrame(number, time, self._decode(raw, f"{self.name}: frame {number}"))
        self.cut = self._frames.cut


class _Frames:
    """The stored frames of a file.

    shape  (frames, height, width)
    dtype  of a stored value
    times  (frames,) s, or None
    own    the file's camera parameters
    cut    after the last frame: the reason why there are fewer than in ``shape``, else empty
    """

    shape: tuple[int, int, int]
    dtype: np.dtype[Any]
    times: NDArray[np.float64] | None = None
    own: CameraInfo = UNKNOWN
    cut: str = ""

    def __init__(self, path: Path) -> None:
        raise NotImplementedError

    def __iter__(self) -> Iterator[NDArray[Any]]:
        raise NotImplementedError


class _Npy(_Frames):
    def __init__(self, path: Path) -> None:
        self._source = Source(path, "the depth frames")
        start = self._source.read(0, min(HEADER, self._source.size))
        self._header = header_of(start, str(path))
        self.shape, self.dtype = self._header.stack(str(path)), self._header.dtype
        self._whole = (self._source.size - self._header.start) // self._header.frame_bytes
        if self._whole < 1:
            raise DataError(f"{path}: ends within its first frame, at byte {self._source.size}")

    def __iter__(self) -> Iterator[NDArray[Any]]:
        header = self._header
        for number in range(min(self._whole, self.shape[0])):
            raw = self._source.read(header.start + number * header.frame_bytes, header.frame_bytes)
            yield header.frame(raw)
        if self._whole < self.shape[0]:
            self.cut = (
                f"{self._source.path}: ends after {self._whole} whole frames, its header announces {self.shape[0]}"
            )


class _Npz(_Frames):
    def __init__(self, path: Path) -> None:
        self._file = NpzFile(path)
        self._name, header = self._file.stack()
        self.shape, self.dtype, self._header = header.stack(str(path)), header.dtype, header
        small = self._file.small()
        self.times = _checked_times(small.pop("time", None), self.shape[0], path)
        self.own = _own(small, path)

    def __iter__(self) -> Iterator[NDArray[Any]]:
        yield from self._file.frames(self._name, self._header)


class _Hdf5(_Frames):
    def __init__(self, path: Path) -> None:
        with hdf5.opened(path, "the depth frames") as file:
            found = {name: np.asarray(value) for name, value in file.attrs.items()}
            timed = "time" in file
        (self._rows,) = hdf5.File(path, ("depth",)).datasets
        self.shape, self.dtype = Header(self._rows.shape, self._rows.dtype, 0).stack(str(path)), self._rows.dtype
        times = hdf5.File(path, ("time",)).datasets[0].numbers() if timed else None
        self.times = _checked_times(times, self.shape[0], path)
        self.own = _own(found, path)

    def __iter__(self) -> Iterator[NDArray[Any]]:
        for number in range(self.shape[0]):
            yield self._rows[number] if len(self._rows.shape) == 3 else self._rows[:]


def _own(found: Mapping[str, NDArray[Any]], path: Path) -> CameraInfo:
    """The camera parameters in the other arrays of the file. Raises DataError."""
    keys = [key for key in camera_file.KEYS if key in found and ("fx" in found or key not in OF_ANYTHING)]
    said = {key: _plain(found[key], f"{path}: {key}") for key in keys}
    own = camera_file.of(said, str(path)) if said else UNKNOWN
    if "camera" not in found:
        return own
    if found["camera"].size != 1:
        raise DataError(f"{path}: camera has the shape {found['camera'].shape}, expected one text: a camera.json")
    return own.or_else(camera_file.parse(_text(found["camera"]), f"{path}: camera"))


def _plain(value: NDArray[Any], where: str) -> float | list[float] | str:
    """An array as a value of JSON. Raises DataError."""
    if value.dtype.kind in "iuf" and value.ndim <= 1:
        numbers = [float(one) for one in value.ravel()]
        return numbers[0] if len(numbers) == 1 else numbers
    if value.dtype.kind in "SUO" and value.size == 1:
        return _text(value)
    raise DataError(f"{where} is {value.dtype} {value.shape}, expected a number, a row of numbers, or a text")


def _text(value: NDArray[Any]) -> str:
    text = value.reshape(-1)[0]
    return text.decode("utf-8", "replace") if isinstance(text, bytes) else str(text)


def _checked_times(times: NDArray[Any] | None, count: int, path: Path) -> NDArray[np.float64] | None:
    """Times of the frames. Raises DataError for others than one ascending number for each."""
    if times is None:
        return None
    if times.shape != (count,) or times.dtype.kind not in "iuf":
        raise DataError(
            f"{path}: time is {times.dtype} {times.shape}, expected ({count},): seconds, one for each frame"
        )
    seconds = times.astype(np.float64)
    bad = ~(np.diff(seconds, prepend=-math.inf) > 0) | ~np.isfinite(seconds)
    if bad.any():
        at = int(np.argmax(bad))
        raise DataError(f"{path}: time[{at}] is {seconds[at]:g}; expected finite seconds, each after the one before")
    return seconds
