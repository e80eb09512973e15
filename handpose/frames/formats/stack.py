"""Stacks of depth frames in one array: .npy and .npz.

An .npy file is an array (frames, height, width) of integers of 16 bits or more, or of floating-point numbers. In an
.npz file it is called depth, or is the only one with three axes; ``other_arrays`` reads the others. Frames are read one
by one, so a stack may exceed the memory.
"""

from __future__ import annotations

import contextlib
import math
import warnings
import zipfile
from collections.abc import Iterator, Mapping, Sequence
from io import BufferedReader
from pathlib import Path
from typing import IO, Any, NamedTuple

import numpy as np
from numpy.lib import format as npy
from numpy.typing import NDArray

from handpose.frames import camera_file
from handpose.frames.formats.other_arrays import recognise
from handpose.frames.raw import calibration_of, check_values
from handpose.frames.recording import UNKNOWN, CameraInfo, DepthFrame, Recording
from netlib import files
from netlib.errors import DataError, NetlibError, reason_of, system_error_of
from netlib.files.pictures import MAX_PIXELS

WHAT = "the depth frames"
READERS = {(1, 0): npy.read_array_header_1_0, (2, 0): npy.read_array_header_2_0}
SMALL = 1 << 24  # bytes; maximum size of the other arrays
PARAMETERS = "biufSUM"  # their kinds: numbers, texts and dates


def open_stack(path: Path, given: CameraInfo = UNKNOWN) -> Recording:
    """The frames of an .npy or .npz file. Raises DataError."""
    return StackRecording(path, (_Npy if path.suffix.lower() == ".npy" else _Npz)(path), given)


class StackRecording(Recording):
    """The frames of an array."""

    def __init__(self, path: Path, frames: _Npy | _Npz, given: CameraInfo) -> None:
        camera_json = camera_file.next_to(path)
        found = recognise(frames.others, frames.names, frames.shape[0], str(path), given, camera_json)
        calibration = calibration_of(given, found.own, camera_json, frames.shape[1:], frames.dtype, str(path))
        self.name, self.camera, self.unit_mm = str(path), calibration.camera, calibration.unit_mm
        self.count, self.rate, self._times = frames.shape[0], calibration.rate, found.times
        self.remarks, self.warnings = (*found.remarks, *calibration.remarks), found.warnings
        if self._times is None and given.time_unit is not None:
            raise DataError(f"{path}: has no times, so --time-unit has no meaning; expected an array time")
        if self._times is None and self.count > 1:
            self.rate, remarks = calibration.paced()
            self.remarks += remarks
        self._frames, self._decode = frames, calibration.decoder(self.name)

    def __iter__(self) -> Iterator[DepthFrame]:
        times = self._times
        for number, raw in enumerate(self._frames):
            time = number / (self.rate or 1.0) if times is None else float(times[number] - times[0])
            yield DepthFrame(number, time, self._decode(raw, f"{self.name}: frame {number}"))


class _Npy:
    """The frames of an .npy file, mapped into memory. The members are those of _Npz."""

    others: Mapping[str, NDArray[Any]] = {}
    names: Sequence[str] = ()

    def __init__(self, path: Path) -> None:
        with _errors_of(path, "cut, or not an array as NumPy writes it"), files.opened(path, WHAT):
            array = npy.open_memmap(path, mode="r")
        self._array = array[None] if array.ndim == 2 else array
        self.shape, self.dtype = _stack_shape(array.shape, array.dtype, str(path)), array.dtype

    def __iter__(self) -> Iterator[NDArray[Any]]:
        yield from self._array


class _Header(NamedTuple):
    """The header of an array."""

    shape: tuple[int, ...]
    by_columns: bool
    dtype: np.dtype[Any]


class _Npz:
    """The frames of an .npz file. Raises DataError, also while they are read.

    shape   (frames, height, width)
    dtype   of a stored value
    others  the other arrays of the file, by name: small ones of numbers, texts and dates
    names   of all other arrays
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        with self._opened() as archive:
            headers = {}
            for entry in archive.namelist():
                if entry.endswith(".npy"):
                    with archive.open(entry) as stream:
                        headers[entry[:-4]] = _header(stream)
            stacks = [name for name, header in headers.items() if len(header.shape) == 3]
            self._name = "depth" if "depth" in headers else stacks[0] if len(stacks) == 1 else ""
            if not self._name:
                content = ", ".join(f"{name} {header.shape}" for name, header in headers.items()) or "nothing"
                raise DataError(f"{path}: holds {content}; expected an array depth (frames, height, width)")
            shape, by_columns, self.dtype = headers.pop(self._name)
            self.shape = _stack_shape(shape, self.dtype, str(path))
            if by_columns and len([size for size in shape if size > 1]) > 1:
                raise DataError(f"{path}: an array in Fortran's order; write it with numpy.ascontiguousarray")
            self.names, self.others = list(headers), {}
            for name, header in headers.items():
                size = max(archive.getinfo(f"{name}.npy").file_size, math.prod(header.shape) * header.dtype.itemsize)
                if size <= SMALL and header.dtype.kind in PARAMETERS:
                    with archive.open(f"{name}.npy") as stream:
                        self.others[name] = npy.read_array(stream, allow_pickle=False)

    def __iter__(self) -> Iterator[NDArray[Any]]:
        count = math.prod(self.shape[1:]) * self.dtype.itemsize
        with self._opened() as archive, archive.open(f"{self._name}.npy") as stream:
            _header(stream)
            for _ in range(self.shape[0]):
                content = stream.read(count)
                if len(content) < count:
                    raise EOFError("it ends within a frame")
                yield np.frombuffer(content, self.dtype).reshape(self.shape[1:])
            stream.read(1)  # the checksum is verified at the end

    @contextlib.contextmanager
    def _opened(self) -> Iterator[zipfile.ZipFile]:
        damaged = _errors_of(self._path, "a damaged .npz file")
        with BufferedReader(files.opened(self._path, WHAT)) as stream, damaged, zipfile.ZipFile(stream) as archive:
            yield archive


@contextlib.contextmanager
def _errors_of(path: Path, what: str) -> Iterator[None]:
    """Turn any exception into a DataError: for a damaged file, NumPy and the decoders may raise any."""
    try:
        yield
    except NetlibError:
        raise
    except Exception as error:
        system = system_error_of(error)
        raise DataError(f"{path}: {f'cannot read {WHAT}' if system else what}: "
                        f"{reason_of(system or error)[:200]}") from error


def _header(stream: IO[bytes]) -> _Header:
    """The header of an array; then the stream is at its first value. Raises ValueError, and what NumPy raises."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # headers written by Python 2
        version = npy.read_magic(stream)
        if version not in READERS:
            raise ValueError(f"the version of an array is {version[0]}.{version[1]}")
        return _Header(*READERS[version](stream))


def _stack_shape(shape: tuple[int, ...], dtype: np.dtype[Any], where: str) -> tuple[int, int, int]:
    """Number of frames, height and width; one image is a stack, too. Raises DataError for other shapes and types."""
    if len(shape) not in (2, 3) or min(shape) < 1 or math.prod(shape[-2:]) > MAX_PIXELS:
        raise DataError(f"{where}: an array of shape {shape}; expected (frames, height, width)")
    check_values(dtype, where)
    frames, height, width = (1,) * (3 - len(shape)) + tuple(shape)
    return frames, height, width
