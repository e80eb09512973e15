"""Times, and parameters of the camera, in the arrays of an .npz file beside its frames.

They are recognised by their usual names:

times    time, times, t, ts, timestamp, timestamps, stamp, stamps, also after ``depth_`` or
         ``frame_``; a name may end with its unit, as in ``timestamps_us``
others   the names of ``camera_file``; ``camera``, the whole text of a camera.json
"""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from handpose.frames import camera_file
from handpose.frames.camera_keys import SIZE, has_camera, is_known
from handpose.frames.camera_search import find
from handpose.frames.recording import CameraInfo
from handpose.frames.time_units import TIME_UNITS, clock_of
from netlib.errors import DataError, some_of

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
PARAMETER_KINDS = "biufSUM"  # numbers, texts and dates


def is_parameter(name: str, dtype: np.dtype[Any]) -> bool:
    """Whether an array has times or parameters, by its name and its kind."""
    is_named = is_known(name) or TIMES.fullmatch(base_name(name)) or name == CAMERA_TEXT
    return bool(is_named) and dtype.kind in PARAMETER_KINDS


def base_name(name: str) -> str:
    """The name of an array without those of the groups around it."""
    return name.rpartition(".")[2]


def not_used(others: Sequence[str], fields: Collection[str], timed: str | None) -> tuple[str, ...]:
    """The warning about arrays that are not used, if there are any.

    others  names of the arrays without the depth
    fields  names of parameters that are used, without those of groups
    timed   the array of times
    """
    names = [name for name in others if base_name(name) not in fields and name != timed]
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
    found = find(_nested(arrays, where), where, given.camera is not None)
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
    named = {name: value for name, value in arrays.items() if TIMES.fullmatch(base_name(name))}
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
    if clock := clock_of(times.tolist()):
        return clock.unit, str(clock)
    if name == IN_SECONDS:
        return "s", "taken for s; --time-unit if wrong"
    step = np.median(np.diff(times)) if len(times) > 1 else 0
    raise DataError(
        f"{where}: {name} has times of an unknown unit, with a usual step of {step:g}; give --time-unit "
        f"{', '.join(TIME_UNITS)}, or call the array {name}_ms"
    )
