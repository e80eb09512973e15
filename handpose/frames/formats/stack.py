"""Stacks of depth frames in one array: .npy and .npz.

An .npy file is an array (frames, height, width) of integers of 16 bits or more, or of
floating-point numbers. In an .npz file it is called depth, is the only one with three axes, or the
only one of them whose name has "depth". Names may begin with those of groups, each with a dot.
Frames are read one by one, so a stack may exceed the memory. ``stack_parameters`` has the names of
the other arrays of an .npz file.
"""

from __future__ import annotations

import contextlib
import math
import warnings
import zipfile
from collections.abc import Iterator, Mapping, Sequence
from io import BufferedReader
from pathlib import Path
from typing import IO, Any, Literal, NamedTuple

import numpy as np
from numpy.lib import format as npy
from numpy.typing import NDArray

from handpose.frames.camera_places import next_to
from handpose.frames.formats.stack_parameters import (
    base_name,
    checked_times,
    is_parameter,
    name_of_times,
    not_used,
    parameters_in,
    unit_of_times,
)
from handpose.frames.images import OTHER_KIND, errors_of, is_other_kind
from handpose.frames.recording import (
    RATE,
    UNKNOWN,
    CameraInfo,
    DepthDecoder,
    DepthFrame,
    NotDepthError,
    Recording,
    check_values,
)
from handpose.frames.time_units import TICKS
from netlib import files
from netlib.errors import DataError, some_of
from netlib.files.pictures import MAX_PIXELS

CONTENT = "the depth frames"  # in errors
EXPECTED_AXES = {
    False: "(frames, height, width)",
    True: "(height, width); a file with several frames is opened by its name",
}
# px, of the depth frames of usual cameras
FRAME_SIZES = (
    *({120 * i, 160 * i} for i in (1, 2, 4)),
    *({90 * i, 160 * i} for i in (2, 4, 8)),
    *({200 * i, 320 * i} for i in (1, 2, 4)),
    {424, 512},
    {288, 320},
    {576, 640},
    {480, 848},
    {270, 480},
    {240, 424},
    {192, 256},
    {172, 224},
)
HEADER_READERS = {(1, 0): npy.read_array_header_1_0, (2, 0): npy.read_array_header_2_0}


class StackRecording(Recording):
    """The frames of an .npy or .npz file. Raises DataError, also for times of an unknown unit.

    The first remark is what was taken from which of the other arrays; ``warnings`` names those
    that are not used.
    """

    def __init__(self, path: Path, given: CameraInfo = UNKNOWN) -> None:
        self._frames = frames = arrays_in(path)
        self.name = where = str(path)
        self.count = count = frames.shape[0]
        own, fields, taken = parameters_in(frames.others, where, given)
        camera_json = next_to(path, given.camera is None and own.camera is None)
        self._times = None  # in seconds
        timed = name_of_times(frames.others, count)
        if timed is not None:
            self._times, how = self._timed_by(timed, given, own, camera_json)
            taken.append(f"times from {timed!r}, {how}")
        elif given.time_unit is not None:
            raise DataError(
                f"{path}: has no times, so --time-unit has no meaning; expected an array time"
            )
        self._decode_by(
            DepthDecoder(frames.shape[1:], frames.dtype, where, given, own, camera_json)
        )
        if taken:
            self.remarks = ("; ".join(taken), *self.remarks)
        if timed is None and count > 1:
            self._assume_rate()
        self.warnings = not_used(frames.names, fields, timed)
        if is_other_kind(path.name, frames.name):
            self.warnings = (*self.warnings, OTHER_KIND)

    def _timed_by(
        self, name: str, given: CameraInfo, own: CameraInfo, camera_json: CameraInfo
    ) -> tuple[NDArray[np.float64], str]:
        """The times in an array, in seconds, and how their unit is known. Raises DataError."""
        frames = self._frames
        times = checked_times(frames.others[name], frames.shape[0], f"{self.name}: {name}")
        unit, how = unit_of_times(name, times, self.name, given.time_unit, own, camera_json)
        rate = given.or_else(own).or_else(camera_json).rate or RATE
        per_second = TICKS.get(unit, rate)  # the unit may be frames
        return times / per_second, how

    def __iter__(self) -> Iterator[DepthFrame]:
        times = self._times
        for number, raw in enumerate(self._frames):
            time = number / (self.rate or 1.0) if times is None else float(times[number] - times[0])
            yield DepthFrame(number, time, self._decode(raw, f"{self.name}: frame {number}"))


def arrays_in(path: Path, is_single: bool = False) -> _NpyFrames | _NpzFrames:
    """The frames of an .npy or .npz file, of which there is one if it ``is_single``.

    Raises NotDepthError for arrays that cannot be depth, and another DataError for a damaged file.
    """
    return (_NpyFrames if path.suffix.lower() == ".npy" else _NpzFrames)(path, is_single)


class _NpyFrames:
    """The frames of an .npy file, mapped into memory. The members are those of _NpzFrames."""

    others: Mapping[str, NDArray[Any]] = {}
    names: Sequence[str] = ()
    name = ""

    def __init__(self, path: Path, is_single: bool) -> None:
        with (
            errors_of(str(path), CONTENT, "cut, or not an array as NumPy writes it"),
            files.opened(path, CONTENT),
        ):
            array = npy.open_memmap(path, mode="r")
        self.shape = _checked_shape(array.shape, array.dtype, str(path), is_single)
        self.dtype = array.dtype
        self._array = array.reshape(self.shape)

    def __iter__(self) -> Iterator[NDArray[Any]]:
        yield from self._array


class _Header(NamedTuple):
    """The header of an array."""

    shape: tuple[int, ...]
    by_columns: bool
    dtype: np.dtype[Any]


class _NpzFrames:
    """The frames of an .npz file. Raises DataError, also while they are read.

    shape   (frames, height, width)
    dtype   of a stored value
    others  the other arrays of the file whose names are known, by name
    names   of all other arrays
    name    of the array of frames
    """

    def __init__(self, path: Path, is_single: bool) -> None:
        self._path = path
        with self._opened() as archive:
            headers = {}
            for entry in archive.namelist():
                if entry.endswith(".npy"):
                    with archive.open(entry) as stream:
                        headers[entry[:-4]] = _header(stream)
            self.name = _name_of_depth(headers, str(path), is_single)
            shape, by_columns, self.dtype = headers.pop(self.name)
            self.shape = _checked_shape(shape, self.dtype, str(path), is_single)
            self._order: Literal["F", "C"] = "F" if by_columns else "C"
            if by_columns and self.shape[0] > 1:
                raise DataError(
                    f"{path}: an array in Fortran's order; write it with numpy.ascontiguousarray"
                )
            self.names = list(headers)
            self.others = {}
            for name, header in headers.items():
                if is_parameter(name, header.dtype):
                    with archive.open(f"{name}.npy") as stream:
                        self.others[name] = npy.read_array(stream, allow_pickle=False)

    def __iter__(self) -> Iterator[NDArray[Any]]:
        frame_bytes = math.prod(self.shape[1:]) * self.dtype.itemsize
        with self._opened() as archive, archive.open(f"{self.name}.npy") as stream:
            _header(stream)
            for _ in range(self.shape[0]):
                content = stream.read(frame_bytes)
                if len(content) < frame_bytes:
                    raise EOFError("it ends within a frame")
                yield np.frombuffer(content, self.dtype).reshape(self.shape[1:], order=self._order)
            stream.read(1)  # the checksum is verified at the end

    @contextlib.contextmanager
    def _opened(self) -> Iterator[zipfile.ZipFile]:
        damaged = errors_of(str(self._path), CONTENT, "a damaged .npz file")
        with (
            BufferedReader(files.opened(self._path, CONTENT)) as stream,
            damaged,
            zipfile.ZipFile(stream) as archive,
        ):
            yield archive


def _header(stream: IO[bytes]) -> _Header:
    """The header of an array; then the stream is at its first value.

    Raises ValueError, and what NumPy raises.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # headers written by Python 2
        version = npy.read_magic(stream)
        if version not in HEADER_READERS:
            raise ValueError(f"the version of an array is {version[0]}.{version[1]}")
        return _Header(*HEADER_READERS[version](stream))


def _name_of_depth(headers: Mapping[str, _Header], where: str, is_single: bool) -> str:
    """The name of the array of frames. Raises NotDepthError without one, and for several."""
    if "depth" in headers:
        return "depth"
    axes = 2 if is_single else 3
    images = [name for name, header in headers.items() if len(header.shape) == axes]
    by_itself = [name for name in images if "depth" in base_name(name).lower()]
    by_group = [name for name in images if "depth" in name.lower()]
    for candidates in images, by_itself, by_group:
        if len(candidates) == 1:
            return candidates[0]
    shown = [f"{name} {header.shape}" for name, header in headers.items()]
    content = some_of(shown) or "nothing"
    raise NotDepthError(
        f"{where}: holds {content}; expected an array depth {EXPECTED_AXES[is_single]}"
    )


def _are_last(shape: tuple[int, ...]) -> bool:
    """Whether the last of three axes is that of the frames, as in MATLAB: the others are the size
    of a camera, and the last two are none, or there are few frames.
    """
    by_size = {*shape[:2]} in FRAME_SIZES and {*shape[1:]} not in FRAME_SIZES
    return by_size or 4 * shape[2] < min(shape[:2])


def _checked_shape(
    shape: tuple[int, ...], dtype: np.dtype[Any], where: str, is_single: bool
) -> tuple[int, ...]:
    """The shape (frames, height, width) of an array.

    Raises NotDepthError unless it may be frames, or a single one.
    """
    frames = shape
    advice = ""
    if is_single and shape[2:] in ((), (1,)):
        frames = (1, *shape[:2])
    elif is_single and shape[:1] != (1,):
        frames = ()
    elif len(shape) == 3 and _are_last(shape):
        advice = ": np.moveaxis(array, 2, 0)"
    has_pixels = len(frames) == 3 and min(frames) > 0
    if advice or not has_pixels or math.prod(frames[1:]) > MAX_PIXELS:
        raise NotDepthError(
            f"{where}: an array of shape {shape}; expected {EXPECTED_AXES[is_single]}{advice}"
        )
    check_values(dtype, where)
    return frames
