"""Stacks of depth frames in one array: .npy and .npz.

An .npy file is an array (frames, height, width) of integers of 16 bits or more, or of
floating-point numbers. In an .npz file it is called depth, is the only one with three axes, or the
only one of them whose name has "depth". Names may begin with those of groups, each with a dot.
Frames are read one by one, so a stack may exceed the memory. The other arrays of an .npz file are
recognised by their usual names:

times    time, times, t, ts, timestamp, timestamps, stamp, stamps, also after ``depth_`` or
         ``frame_``; a name may end with its unit, as in ``timestamps_us``
others   the names of ``camera_file``; ``camera``, the whole text of a camera.json
"""

from __future__ import annotations

import contextlib
import math
import re
import warnings
import zipfile
from collections.abc import Collection, Iterator, Mapping, Sequence
from io import BufferedReader
from pathlib import Path
from typing import IO, Any, Literal, NamedTuple

import numpy as np
from numpy.lib import format as npy
from numpy.typing import NDArray

from handpose.frames import camera_file
from handpose.frames.camera_keys import SIZE, has_camera, is_known
from handpose.frames.camera_places import next_to
from handpose.frames.images import errors_of
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
from handpose.frames.time_units import TICKS, since_1970
from netlib import files
from netlib.errors import DataError, some_of
from netlib.files.pictures import MAX_PIXELS

CONTENT = "the depth frames"  # in errors
EXPECTED_AXES = {
    False: "(frames, height, width)",
    True: "(height, width); a file with several frames is opened by its name",
}
HEADER_READERS = {(1, 0): npy.read_array_header_1_0, (2, 0): npy.read_array_header_2_0}
PARAMETER_KINDS = "biufSUM"  # numbers, texts and dates


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
    """

    def __init__(self, path: Path, is_single: bool) -> None:
        self._path = path
        with self._opened() as archive:
            headers = {}
            for entry in archive.namelist():
                if entry.endswith(".npy"):
                    with archive.open(entry) as stream:
                        headers[entry[:-4]] = _header(stream)
            self._name = _name_of_depth(headers, str(path), is_single)
            shape, by_columns, self.dtype = headers.pop(self._name)
            self.shape = _checked_shape(shape, self.dtype, str(path), is_single)
            self._order: Literal["F", "C"] = "F" if by_columns else "C"
            if by_columns and self.shape[0] > 1:
                raise DataError(
                    f"{path}: an array in Fortran's order; write it with numpy.ascontiguousarray"
                )
            self.names = list(headers)
            self.others = {}
            for name, header in headers.items():
                is_used = is_known(name) or TIMES.fullmatch(_base_name(name)) or name == CAMERA_TEXT
                if is_used and header.dtype.kind in PARAMETER_KINDS:
                    with archive.open(f"{name}.npy") as stream:
                        self.others[name] = npy.read_array(stream, allow_pickle=False)

    def __iter__(self) -> Iterator[NDArray[Any]]:
        frame_bytes = math.prod(self.shape[1:]) * self.dtype.itemsize
        with self._opened() as archive, archive.open(f"{self._name}.npy") as stream:
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
    by_itself = [name for name in images if "depth" in _base_name(name).lower()]
    by_group = [name for name in images if "depth" in name.lower()]
    for candidates in images, by_itself, by_group:
        if len(candidates) == 1:
            return candidates[0]
    shown = [f"{name} {header.shape}" for name, header in headers.items()]
    content = some_of(shown) or "nothing"
    raise NotDepthError(
        f"{where}: holds {content}; expected an array depth {EXPECTED_AXES[is_single]}"
    )


def _base_name(name: str) -> str:
    """The name of an array without those of the groups around it."""
    return name.rpartition(".")[2]


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
    elif len(shape) == 3 and 4 * shape[2] < min(shape[:2]):  # the frames are the last axis
        advice = ": np.moveaxis(array, 2, 0)"
    has_pixels = len(frames) == 3 and min(frames) > 0
    if advice or not has_pixels or math.prod(frames[1:]) > MAX_PIXELS:
        raise NotDepthError(
            f"{where}: an array of shape {shape}; expected {EXPECTED_AXES[is_single]}{advice}"
        )
    check_values(dtype, where)
    return frames


# ------------------------------------------------------------------------------------- other arrays

UNIT_WORDS = {
    "s": "s sec secs second seconds",
    "ms": "ms msec millis milliseconds",
    "us": "us usec micros microseconds",
    "ns": "ns nsec nanos nanoseconds",
}
UNIT_OF_WORD = {word: unit for unit, words in UNIT_WORDS.items() for word in words.split()}
TIMES = re.compile(
    rf"(?:depth_|frame_)?(?:t|ts|times?|time_?stamps?|stamps?)(?:_(?:{'|'.join(UNIT_OF_WORD)}))?",
    re.I,
)
# the one name whose times are seconds unless they are times since 1970 in another unit
IN_SECONDS = "time"
AMBIGUOUS = ("name", "model", *SIZE)  # keys that are used only with a camera
CAMERA_TEXT = "camera"  # the name of the whole text of a camera.json
MAX_VALUES = 1000  # in an array of parameters
MAX_CAMERA_VALUES = 16  # in an array of the parameters by which a camera is recognised: 4 x 4


def not_used(others: Sequence[str], fields: Collection[str], timed: str | None) -> tuple[str, ...]:
    """The warning about arrays that are not used, if there are any.

    others  names of the arrays without the depth
    fields  names of parameters that are used, without those of groups
    timed   the array of times
    """
    names = [name for name in others if _base_name(name) not in fields and name != timed]
    if not names:
        return ()
    shown = some_of(map(repr, names))
    what = f"array {shown} is" if len(names) == 1 else f"arrays {shown} are"
    return (
        f"{what} not used; known names are time, timestamps and the like, K, fx, fy, cx, cy, depth_scale, "
        "fps and all keys of a camera.json (docs/camera.md)",
    )


def parameters_in(
    arrays: Mapping[str, NDArray[Any]], where: str, given: CameraInfo
) -> tuple[CameraInfo, dict[str, str], list[str]]:
    """The parameters in arrays, the field of CameraInfo for each array that is used, and a remark
    about those that are not ``given``.

    Raises DataError.
    """
    found = camera_file.find(_nested(arrays, where), where, given.camera is not None)
    info, fields = found.info, found.fields
    if CAMERA_TEXT in arrays:
        text = str(_plain(arrays[CAMERA_TEXT], f"{where}: camera"))
        info = info.or_else(camera_file.parse(text, f"{where}: camera"))
        fields = {**fields, CAMERA_TEXT: "parameters"}
    overridden = {field for field, value in vars(given).items() if value is not None}
    if given.camera:
        overridden.add("lens")
    used = [repr(name) for name, field in fields.items() if field not in overridden]
    return info, fields, [f"parameters from {', '.join(used)}"] if used else []


def _nested(arrays: Mapping[str, NDArray[Any]], where: str) -> dict[str, Any]:
    """The values of arrays with known names, in an object for each group. Raises DataError."""
    small = {
        name: value.tolist() for name, value in arrays.items() if value.size <= MAX_CAMERA_VALUES
    }
    is_camera = has_camera(small)
    nested: dict[str, Any] = {}
    for name, value in arrays.items():
        if is_known(name) and (is_camera or name not in AMBIGUOUS):
            *groups, key = name.split(".")
            inner = nested
            for group in groups:
                inner = inner.setdefault(group, {})
            inner[key] = _plain(value, f"{where}: {name}")
    return nested


def _plain(value: NDArray[Any], where: str) -> Any:
    """An array as a value of JSON: numbers, or one text. Raises DataError."""
    is_text = value.dtype.kind in "SU"
    if value.size > (1 if is_text else MAX_VALUES):
        raise DataError(f"{where} is {value.dtype} {value.shape}, expected numbers, or a text")
    plain = value.squeeze().tolist()
    return plain.decode("utf-8", "replace") if isinstance(plain, bytes) else plain


def name_of_times(arrays: Mapping[str, NDArray[Any]], count: int) -> str | None:
    """The array of times: ``time``, otherwise the first whose name has a unit, otherwise the first.

    A single number may be the date of the recording, and a ``t`` of another length a translation.
    """
    named = {name: value for name, value in arrays.items() if TIMES.fullmatch(_base_name(name))}
    possible = [
        name
        for name, value in named.items()
        if name == IN_SECONDS or value.size == count or (value.ndim and name != "t")
    ]
    return min(
        possible, key=lambda name: (name != IN_SECONDS, _unit_in(name) is None), default=None
    )


def _unit_in(name: str) -> str | None:
    """The unit at the end of a name of times."""
    return UNIT_OF_WORD.get(name.rpartition("_")[2].lower())


def checked_times(times: NDArray[Any], count: int, where: str) -> NDArray[np.float64]:
    """Times of the frames, of dates in ns.

    Raises DataError for others than one ascending number for each.
    """
    if times.dtype.kind == "M":
        times = times.astype("datetime64[ns]").astype(np.int64)
    if times.size != count or times.squeeze().ndim > 1 or times.dtype.kind not in "iuf":
        raise DataError(
            f"{where} is {times.dtype} {times.shape}, expected ({count},): a time for each frame"
        )
    numbers = times.astype(np.float64).ravel()
    wrong = ~(np.diff(numbers, prepend=-np.inf) > 0) | ~np.isfinite(numbers)
    if wrong.any():
        first = int(np.argmax(wrong))
        raise DataError(
            f"{where}[{first}] is {numbers[first]:g}; expected finite times, each after the one before"
        )
    return numbers


def unit_of_times(
    name: str,
    times: NDArray[np.float64],
    where: str,
    given: str | None,
    own: CameraInfo,
    camera_json: CameraInfo,
) -> tuple[str, str]:
    """The unit of times, and how it is known. Raises DataError if it is unknown.

    name         of their array
    given        the unit that the user gives
    own          parameters in the file of the times
    camera_json  parameters next to that file
    """
    sources = (
        (given, "as given"),
        (_unit_in(name), "by its name"),
        (own.time_unit, "as the file says"),
        (camera_json.time_unit, "by camera.json"),
    )
    for unit, how in sources:
        if unit is not None:
            return unit, f"in {unit} {how}"
    if unit := since_1970(times.tolist()):
        return unit, f"in {unit} since 1970"
    if name == IN_SECONDS:
        return "s", "taken for s; --time-unit if wrong"
    step = np.median(np.diff(times)) if len(times) > 1 else 0
    raise DataError(
        f"{where}: {name} has times of an unknown unit, with a usual step of {step:g}; give --time-unit s, "
        f"ms, us, ns or frames, or call the array {name}_ms"
    )
