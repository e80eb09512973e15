"""The other arrays of a file with frames, under their usual names: times, camera, unit, rate.

times    time, times, t, ts, timestamp, timestamps, stamp, stamps, also after ``depth_`` or ``frame_``; a name may end
         with its unit, as in ``timestamps_us``
camera   a matrix called as in ``MATRICES``: 3 x 3, or fx, fy, cx, cy
others   the keys of a camera.json, and ``ALIASES``; ``camera``, its whole text; ``unit``, a word or a number of mm
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from handpose.frames import camera_file
from handpose.frames.formats.frame_names import FRAMES, TICKS, since_1970
from handpose.frames.raw import RATE
from handpose.frames.recording import UNKNOWN, CameraInfo
from netlib.errors import DataError

ENDINGS = {word: unit for unit, words in {
    "s": "s sec secs second seconds", "ms": "ms msec millis milliseconds", "us": "us usec micros microseconds",
    "ns": "ns nsec nanos nanoseconds"}.items() for word in words.split()}
TIMES = re.compile(rf"(?:depth_|frame_)?(?:t|ts|times?|time_?stamps?|stamps?)(?:_({'|'.join(ENDINGS)}))?", re.I)
IN_SECONDS = "time"  # the one name whose times are seconds unless they are times since 1970 in another unit
MATRICES = ("K", "intrinsics", "intrinsic", "intrinsic_matrix", "camera_matrix", "camera_intrinsics",
            "depth_intrinsics", "cam_K", "camera_K", "depth_K", "mtx")
ALIASES = {"frame_rate": "rate", "framerate": "rate", "dist": "coefficients", "dist_coeffs": "coefficients",
           "distortion_coefficients": "coefficients", "D": "coefficients"}
UNITS = ("unit", "units", "depth_unit")  # of the depth, unless a key of a camera.json gives that:
OF_UNIT = ("unit_mm", "depth_scale", "depth_units")
MM = {word: mm for mm, words in {1.0: "mm millimeters millimetres", 10.0: "cm", 1000.0: "m meters metres",
                                 0.001: "um"}.items() for word in words.split()}
OF_ANYTHING = ("name", "model", *camera_file.SIZE)  # ambiguous keys, used only with a camera
TEXT = "camera"  # the name of the whole text of a camera.json
FIELDS = {"camera": "camera", "lens": "distortion", "unit_mm": "unit", "rate": "rate",
          "time_unit": "unit of the times"}  # of CameraInfo, in words
MAX_NAMES = 8  # number of unused arrays that are named


class Recognised(NamedTuple):
    """What was recognised.

    times     (frames,) s, or None
    own       camera parameters
    remarks   at most one line: what was taken from which array
    warnings  at most one line: the arrays that are not used
    """

    times: NDArray[np.float64] | None
    own: CameraInfo
    remarks: tuple[str, ...]
    warnings: tuple[str, ...]


def recognise(
    found: Mapping[str, NDArray[Any]], names: Iterable[str], count: int, where: str, given: CameraInfo,
    camera_json: CameraInfo,
) -> Recognised:
    """What is recognised in the arrays of a file with ``count`` frames.

    found        arrays that are small enough to be parameters
    names        of all arrays but the frames
    where        name of the file, for messages
    given        parameters from the user, which have precedence
    camera_json  those of a camera.json next to the file, over which the file has precedence

    Raises DataError for invalid values, and for times of an unknown unit.
    """
    own, fields = _parameters(found, where, given)
    words = _in_words(fields, given)
    name, times = _name_of_times(found, count), None
    if name is not None:
        numbers = _checked(found[name], count, f"{where}: {name}")
        unit, how = _unit_of_times(name, found[name].dtype, numbers, where, given.time_unit, own, camera_json)
        rate = given.or_else(own).or_else(camera_json).rate or RATE
        times = numbers / (rate if unit == FRAMES else TICKS[unit])
        words.append(f"times from {name!r}, {how}")
    unused = [one for one in names if one not in fields and one != name]
    return Recognised(times, own, ("; ".join(words),) if words else (), (_not_used(unused),) if unused else ())


def _in_words(fields: Mapping[str, str], given: CameraInfo) -> list[str]:
    """What is taken from which arrays; not what the user gave."""
    sources: dict[str, list[str]] = {}
    for name, field in fields.items():
        of_another_camera = field == "lens" and given.camera is not None
        if getattr(given, field, None) is None and not of_another_camera:
            sources.setdefault(FIELDS.get(field, field), []).append(repr(name))
    return [f"{what} from {', '.join(names)}" for what, names in sources.items()]


def _not_used(names: list[str]) -> str:
    """The warning about arrays that are not used."""
    shown = ", ".join(map(repr, names[:MAX_NAMES]))
    more = f" and {len(names) - MAX_NAMES} more" if len(names) > MAX_NAMES else ""
    what = f"array {shown} is" if len(names) == 1 else f"arrays {shown}{more} are"
    return (f"{what} not used; known names are time, timestamps and the like, K, fx, fy, cx, cy, depth_scale, unit, "
            "fps and all keys of a camera.json (docs/camera.md)")


# ---------------------------------------------------------------------------------------------- parameters


def _parameters(found: Mapping[str, NDArray[Any]], where: str, given: CameraInfo) -> tuple[CameraInfo, dict[str, str]]:
    """The parameters in the arrays, and the field of CameraInfo for each array that is used. Raises DataError."""
    said: dict[str, Any] = {}
    fields: dict[str, str] = {}
    readers = (("camera", _of_matrix, MATRICES if "fx" not in found else ()),
               ("unit_mm", _of_unit, UNITS if not {*found} & {*OF_UNIT} else ()))
    for field, read, known in readers:
        for name in [name for name in known if name in found][:1]:
            fields[name] = field
            try:
                said |= read(found[name], f"{where}: {name}")
            except DataError:
                if getattr(given, field) is None:  # what the user gives replaces it, whatever it is
                    raise
    for name, value in found.items():
        key = ALIASES.get(name, name)
        if key not in camera_file.KEYS or (name in OF_ANYTHING and "fx" not in {*said, *found}):
            continue
        if key in said:
            raise DataError(f"{where}: says {key} twice, once as {name}")
        main, said[key] = camera_file.SAME.get(key, (key, 1))[0], _plain(value, f"{where}: {name}")
        is_of_lens = main in (*camera_file.LENS, *camera_file.IGNORED)
        fields[name] = main if main in FIELDS else "lens" if is_of_lens else "camera"
    own = camera_file.of(said, where) if said else UNKNOWN
    if TEXT not in found:
        return own, fields
    if found[TEXT].size != 1:
        raise DataError(f"{where}: camera has the shape {found[TEXT].shape}, expected one text: a camera.json")
    fields[TEXT] = "parameters"
    return own.or_else(camera_file.parse(_text(found[TEXT]), f"{where}: camera")), fields


def _of_matrix(value: NDArray[Any], where: str) -> dict[str, float]:
    """fx, fy, u0, v0 of a matrix, by rows or by columns, or of these four numbers. Raises DataError."""
    numbers = value.squeeze()
    if numbers.dtype.kind in "iuf" and numbers.shape == (4,):
        return dict(zip(camera_file.INTRINSICS, numbers.astype(float).tolist()))
    if numbers.dtype.kind in "iuf" and numbers.shape in ((3, 3), (9,)):
        matrix = numbers.reshape(3, 3).astype(float)
        (fx, skew, u0), (zero, fy, v0), last = (matrix.T if matrix[2, :2].any() else matrix).tolist()
        if skew == zero == 0 and last == [0, 0, 1]:
            return dict(zip(camera_file.INTRINSICS, (fx, fy, u0, v0)))
    shown = numbers.tolist() if numbers.size <= 9 else f"of shape {value.shape}"
    raise DataError(f"{where} is {shown}; expected [[fx, 0, cx], [0, fy, cy], [0, 0, 1]], or fx, fy, cx, cy")


def _of_unit(value: NDArray[Any], where: str) -> dict[str, Any]:
    """unit_mm of a word, or of a number of mm. Raises DataError."""
    plain = _plain(value, where)
    if not isinstance(plain, str):
        return {"unit_mm": plain}
    if plain.lower() not in MM:
        raise DataError(f"{where} is {plain!r}; expected mm, cm, m, um or a number of mm")
    return {"unit_mm": MM[plain.lower()]}


def _plain(value: NDArray[Any], where: str) -> float | bool | list[float] | str:
    """An array as a value of JSON. Raises DataError."""
    if value.dtype.kind == "b" and value.size == 1:
        return bool(value.reshape(-1)[0])
    if value.dtype.kind in "iuf" and value.squeeze().ndim <= 1:
        numbers = [float(one) for one in value.ravel()]
        return numbers[0] if len(numbers) == 1 else numbers
    if value.dtype.kind in "SUO" and value.size == 1:
        return _text(value)
    raise DataError(f"{where} is {value.dtype} {value.shape}, expected a number, a row of numbers, or a text")


def _text(value: NDArray[Any]) -> str:
    text = value.reshape(-1)[0]
    return text.decode("utf-8", "replace") if isinstance(text, bytes) else str(text)


# ---------------------------------------------------------------------------------------------- times


def _name_of_times(found: Mapping[str, NDArray[Any]], count: int) -> str | None:
    """The array of times: ``time``, otherwise the first whose name has a unit, otherwise the first.

    A single number may be the date of the recording, and a ``t`` of another length a translation.
    """
    possible = [name for name, value in found.items() if TIMES.fullmatch(name)
                and (name == IN_SECONDS or value.size == count or (value.ndim and name != "t"))]
    return min(possible, key=lambda name: (name != IN_SECONDS, _ending(name) is None), default=None)


def _ending(name: str) -> str | None:
    """The unit at the end of a name."""
    match = TIMES.fullmatch(name)
    return ENDINGS[match[1].lower()] if match and match[1] else None


def _checked(times: NDArray[Any], count: int, where: str) -> NDArray[np.float64]:
    """Times of the frames. Raises DataError for others than one ascending number for each."""
    if times.size != count or times.squeeze().ndim > 1 or times.dtype.kind not in "iufM":
        raise DataError(f"{where} is {times.dtype} {times.shape}, expected ({count},): a time for each frame")
    if times.dtype.kind == "M":
        times = times.astype("datetime64[ns]").astype(np.int64)
    numbers = times.astype(np.float64).ravel()
    bad = ~(np.diff(numbers, prepend=-np.inf) > 0) | ~np.isfinite(numbers)
    if bad.any():
        at = int(np.argmax(bad))
        raise DataError(f"{where}[{at}] is {numbers[at]:g}; expected finite times, each after the one before")
    return numbers


def _unit_of_times(
    name: str, dtype: np.dtype[Any], times: NDArray[np.float64], where: str, given: str | None, own: CameraInfo,
    camera_json: CameraInfo,
) -> tuple[str, str]:
    """The unit of times, and how it is known. Raises DataError if it is unknown."""
    stored = "ns" if dtype.kind == "M" else None  # a type of dates
    for unit, how in ((stored, "as stored"), (given, "as given"), (_ending(name), "by its name"),
                      (own.time_unit, "as the file says"), (camera_json.time_unit, "by camera.json")):
        if unit is not None:
            return unit, f"in {unit} {how}"
    if unit := since_1970(times.tolist()):
        return unit, f"in {unit} since 1970"
    if name == IN_SECONDS:
        return "s", "taken for s; --time-unit if wrong"
    step = np.median(np.diff(times)) if len(times) > 1 else 0
    raise DataError(f"{where}: {name} has times of an unknown unit, with a usual step of {step:g}; give --time-unit s, "
                    f"ms, us, ns or frames, or call the array {name}_ms")
