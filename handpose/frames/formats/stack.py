"""Stacks of depth frames in one array: .npy, .npz, .h5.

An .npy file is an array (frames, height, width) of integers of 16 bits or more, or of floating-point numbers. In an
.npz or .h5 file it is called depth; ``other_arrays`` reads what else there is, in an .h5 data sets or attributes.
Frames are read one by one, so a stack may exceed the memory.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from handpose.frames import camera_file
from handpose.frames.formats.numpy_files import HEADER, PARAMETERS, SMALL, Header, NpzFile, header_of
from handpose.frames.formats.other_arrays import recognise
from handpose.frames.raw import calibration_of
from handpose.frames.recording import UNKNOWN, CameraInfo, DepthFrame, Recording
from netlib.errors import DataError
from netlib.files import Source, hdf5


def open_stack(path: Path, given: CameraInfo = UNKNOWN) -> Recording:
    """The frames of an .npy, .npz or .h5 file. Raises DataError."""
    kinds: dict[str, type[_Frames]] = {".npy": _Npy, ".npz": _Npz}
    return StackRecording(path, kinds.get(path.suffix.lower(), _Hdf5)(path), given)


class StackRecording(Recording):
    """The frames of an array."""

    def __init__(self, path: Path, frames: _Frames, given: CameraInfo) -> None:
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
        self.cut = self._frames.cut


class _Frames:
    """The stored frames of a file.

    shape   (frames, height, width)
    dtype   of a stored value
    others  the other arrays of the file, by name, without the large ones
    names   of all other arrays
    cut     after the last frame: the reason why there are fewer than in ``shape``, else empty
    """

    shape: tuple[int, int, int]
    dtype: np.dtype[Any]
    others: Mapping[str, NDArray[Any]] = {}
    names: Sequence[str] = ()
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
        self.others, self.names = self._file.small(), self._file.others()

    def __iter__(self) -> Iterator[NDArray[Any]]:
        yield from self._file.frames(self._name, self._header)


class _Hdf5(_Frames):
    def __init__(self, path: Path) -> None:
        with hdf5.opened(path, "the depth frames") as file:
            found = {name: np.asarray(value) for name, value in file.attrs.items()}
            others = {name: file.get(name) for name in file if name != "depth"}
            found |= {name: member[()] for name, member in others.items() if _is_parameter(member)}
            groups = [name for name, one in others.items() if isinstance(one, h5py.Group) and "depth" in one]
            if "depth" not in file and groups:
                raise DataError(f"{path}: depth is in the group {groups[0]!r}; expected a data set 'depth' in no group")
        self.others, self.names = found, list({**found, **others})
        (self._rows,) = hdf5.File(path, ("depth",)).datasets
        self.shape, self.dtype = Header(self._rows.shape, self._rows.dtype, 0).stack(str(path)), self._rows.dtype

    def __iter__(self) -> Iterator[NDArray[Any]]:
        for number in range(self.shape[0]):
            yield self._rows[number] if len(self._rows.shape) == 3 else self._rows[:]


def _is_parameter(member: object) -> bool:
    """True for data sets that are small enough."""
    return isinstance(member, h5py.Dataset) and member.nbytes <= SMALL and member.dtype.kind in PARAMETERS
