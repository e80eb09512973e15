"""camera.json: the parameters of a depth camera, next to its frames or within their file; other files with a camera.

{"fx": 476.0, "fy": 476.0, "u0": 313.7, "v0": 242.8, "width": 640, "height": 480, "unit_mm": 0.125, "rate": 30,
 "distortion": {"model": "brown_conrady", "coefficients": [0.1, -0.2, 0, 0, 0]}}

fx, fy, u0, v0  px, all four or none; cx, cy and ppx, ppy are other names of u0, v0
width, height   px of the frames, both or none
unit_mm         depth of a stored value of 1 in mm; RealSense's depth_scale is in metres
rate            frames per second; also fps
min_range_mm    nearer readings are errors and count as missing; default 200
distortion      of the lens: as above, or the coefficients alone; model, coeffs, k1 ... p2 may also be keys next to fx
name            of the camera
time_unit       of the times in the names of the frames or in their file: s, ms, us, ns, or frames for numbers

Files of other programs are read, too: JSON, YAML (the part in which programs write parameters), and tables of numbers.
In them these keys have the names of RealSense, Open3D, ROS, OpenCV and Kalibr, and

    fx, fy, cx, cy  are also a matrix: 3 x 3 by rows or by columns, within 3 x 4 or 4 x 4, or fx, fy, cx, cy in a row
    width, height   both in a row, as in resolution: [640, 480]
    depth_scale     of a stored value of 1: m, if it is less than 0.01; otherwise mm; from 100 on stored values per m

They may lie within other objects and lists, and have names such as Camera.fx. Of several cameras that of the depth is
taken, by the names around it.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NoReturn

import numpy as np

from handpose.frames.cameras import MIN_FOCAL_PX, MIN_RANGE_MM, Camera
from handpose.frames.lens import Lens, lens_of
from handpose.frames.recording import CameraInfo
from netlib import files
from netlib.errors import DataError, did_you_mean
from netlib.files import atomic
from netlib.files.paths import exists

NAME = "camera.json"
OTHER_NAMES = ("camera.yaml", "camera_info.yaml", "camera_info.json", "intrinsic.json", "intrinsics.json",
               "calibration.json", "intrinsics.txt", "K.txt")  # in a folder of frames


def next_to(source: Path) -> CameraInfo:
    """The camera.json of a recording: in a folder, next to a file as NAME.camera.json or camera.json.

    Raises DataError.
    """
    return next((read(place) for place in places_next_to(source) if exists(place)), CameraInfo())


def places_next_to(source: Path) -> list[Path]:
    """The possible paths of a camera's file, the most specific first."""
    if source.is_dir():
        return [source / name for name in (NAME, *OTHER_NAMES)]
    return [source.with_suffix(f".{NAME}"), source.with_name(NAME)]


def read(path: Path) -> CameraInfo:
    """Read a camera.json, or a file of another program. Raises DataError."""
    return parse(files.read_text(path, "the camera", limit=MAX_BYTES), str(path))


def write(path: Path, given: CameraInfo) -> None:
    """Write a camera.json atomically. Raises OSError."""
    atomic.replace_text(path, to_text(given) + "\n")


def to_text(given: CameraInfo) -> str:
    """The text that ``parse`` reads, without loss of precision."""
    said: dict[str, Any] = {}
    if isinstance(given.camera, Camera):
        said |= {"name": given.camera.name} | {key: float(getattr(given.camera, key)) for key in INTRINSICS}
        if given.camera.width:
            said |= {key: int(getattr(given.camera, key)) for key in SIZE}
        if given.camera.min_range_mm != MIN_RANGE_MM:
            said[MIN_RANGE] = float(given.camera.min_range_mm)
    said |= {key: float(getattr(given, key)) for key in ("unit_mm", "rate") if getattr(given, key) is not None}
    if given.lens is not None and not given.lens.is_straight:
        said["distortion"] = {"model": given.lens.model, "coefficients": list(map(float, given.lens.coefficients))}
    if given.time_unit is not None:
        said["time_unit"] = given.time_unit
    return json.dumps(said, indent=1)


def parse(text: str, where: str) -> CameraInfo:
    """Parse the text of a camera.json or of another file; ``where`` begins every error. Raises DataError."""
    try:
        found = find(parse_document(text, where), where)
    except (ValueError, RecursionError):  # thousands of digits or brackets, brackets that do not match
        raise DataError(f"{where}: not the parameters of a camera") from None
    if found.unused and (found.is_own or found.info.camera is None):
        raise DataError(f"{where}: {unknown_key(found.unused[0])}")
    return found.info if found.is_own else replace(found.info, origin=f"{where} ({found.words})")


# ---------------------------------------------------------------------------------------------- documents

MAX_BYTES = 1 << 22  # of a file; calibrations have some 10,000
NUMBER = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?")
NOT_OF_A_TABLE = re.compile(r"[^\s\d.,;()\[\]eE+-]")  # a matrix as numpy.savetxt or print write it
# key: value, or key = value
ENTRY = re.compile(r"""("[^"]*"\s*|'[^']*'\s*|[^\s"'\[{:=][^:=]*)(?::(?=\s|$)|=)\s*(.*)""")
ELEMENT, TAG = re.compile(r"^\s*(?:-(?:\s+|$))*"), re.compile(r"^![\w!-]*\s*")
COMMENT = re.compile(r"""((?:"[^"]*"|'[^']*'|[^"'#]|(?<!\s)#)*?)(?:(?:^|(?<=\s))#.*)?""")
WORD = re.compile(r"""\s*("[^"]*"|'[^']*'|[^\s\[\]{},:](?:[^\[\]{},:]|:(?=\S))*)""")  # between brackets
WORDS: dict[str, Any] = {"true": True, "false": False, "null": None, "~": None, "": None}


def parse_document(text: str, where: str) -> Any:
    """The value of a text: of a table the list of its numbers. ``where`` begins errors.

    Raises DataError, ValueError, RecursionError.
    """
    if not NOT_OF_A_TABLE.search(text) and (numbers := NUMBER.findall(text)):
        return [float(number) for number in numbers]
    if text.lstrip()[:1] in ("", "{", "["):
        return parsed(text, where)
    if text.lstrip().startswith("<"):
        raise DataError(f"{where}: XML; expected JSON or YAML, which OpenCV's FileStorage writes, too")
    return _of_lines(text, where)


def parsed(text: str, where: str) -> Any:
    """The value of a JSON text without repeated keys. Raises DataError."""

    def unique(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
        found: dict[str, Any] = {}
        for key, value in pairs:
            if key in found:
                raise DataError(f"{where}: has {key!r} twice")
            found[key] = value
        return found

    try:
        return json.loads(text, object_pairs_hook=unique)
    except RecursionError:
        raise DataError(f"{where}: JSON of too many levels") from None
    except ValueError as error:  # JSONDecodeError, and integers of thousands of digits
        raise DataError(f"{where}: not whole JSON: {error}") from None


def _of_lines(text: str, where: str) -> dict[str, Any]:
    """The value of lines ``key: value`` or ``key = value``.

    Deeper lines below a key without a value are an object, elements of a sequence the list of the key above, and a line
    without a value is a key, as in the text of rs-enumerate-devices.
    """
    document: dict[str, Any] = {}
    around = [(-1, document)]  # the objects around a line, each with the indent of its key
    above, inside, key = -1, document, ""  # of the last key: its indent, and the object in which it is
    for line in _logical(text):
        content = ELEMENT.sub("", line)
        indent = len(line) - len(content)
        matched = ENTRY.fullmatch(content)
        if not matched and "-" in line[:indent]:
            if key and inside[key] is None:
                inside[key] = []
            if key and isinstance(inside[key], list):
                inside[key].append(_flow(content))
            continue
        if key and indent > above and inside[key] is None:
            inside[key] = {}
            around.append((above, inside[key]))
        while around[-1][0] >= indent:
            around.pop()
        above, inside = indent, around[-1][1]
        key = _unquoted(matched[1]) if matched else content
        if key in inside:
            raise DataError(f"{where}: has {key!r} twice")
        inside[key] = _flow(TAG.sub("", matched[2], count=1)) if matched else None
    return document


def _logical(text: str) -> Iterator[str]:
    """The lines with content, of the first document; one that ends within brackets is continued by the next."""
    parts, opened, any_content = list[str](), 0, False
    for raw in text.splitlines():
        matched = COMMENT.fullmatch(raw)
        line = (matched[1] if matched else raw).rstrip()
        if not parts and any_content and line in ("---", "..."):
            return
        if not parts and (not line.strip() or line == "---" or line.startswith("%")):
            continue
        any_content = True
        parts.append(line.strip() if parts else line)
        opened += _open_brackets(line)
        if opened <= 0:
            yield " ".join(parts)
            parts, opened = [], 0
    if parts:
        yield " ".join(parts)


def _open_brackets(text: str) -> int:
    bare = re.sub(r""""[^"]*"|'[^']*'""", "", text)
    return sum(map(bare.count, "[{")) - sum(map(bare.count, "]}"))


def _flow(text: str) -> Any:
    """The value of a text in one line: [1, 2], {a: 1}, a number or a word. Raises ValueError."""
    if not text.startswith(("[", "{")):
        return _scalar(text)
    return json.loads(WORD.sub(lambda word: json.dumps(_scalar(word[1])), text))


def _unquoted(text: str) -> str:
    text = text.strip()
    return text[1:-1] if text[0] in "\"'" and text[-1] == text[0] else text


def _scalar(text: str) -> Any:
    text = text.strip()
    if text.lower() in WORDS:
        return WORDS[text.lower()]
    if text[0] in "\"'":
        return _unquoted(text)
    if NUMBER.fullmatch(text):
        return int(text) if re.fullmatch(r"[-+]?\d+", text) else float(text)
    words = text.split()
    return [float(word) for word in words] if all(map(NUMBER.fullmatch, words)) else text  # a row of numbers


# ---------------------------------------------------------------------------------------------- values

RANGES = {  # exclusive lower and inclusive upper bounds
    "fx": (MIN_FOCAL_PX, 1e6), "fy": (MIN_FOCAL_PX, 1e6), "u0": (-1e6, 1e6), "v0": (-1e6, 1e6), "unit_mm": (1e-6, 1e4),
    "rate": (1e-6, 1e4), "width": (0, 1 << 14), "height": (0, 1 << 14), "min_range_mm": (0, 1e4),
}
MIN_RANGE = "min_range_mm"
TICKS = {"s": 1, "ms": 10**3, "us": 10**6, "ns": 10**9}  # per second, of the units of times
FRAMES = "frames"  # the unit of numbers that count frames
TIME_UNITS = (*TICKS, FRAMES)
EPOCH = (946684800, 4102444800)  # s since 1970 of the years 2000 and 2100
INTRINSICS, SIZE = ("fx", "fy", "u0", "v0"), ("width", "height")
BROWN = ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")  # in OpenCV's order
LENS = ("distortion", "model", "coefficients", *BROWN)
FIELDS = ("unit_mm", "rate", "time_unit")  # those that are fields of CameraInfo
KNOWN = (*RANGES, "name", *LENS, "time_unit")  # the keys of a camera.json
# Other names, without capitals and without what is no letter or digit.
ALIASES = {key.replace("_", ""): key for key in KNOWN} | {alias: key for key, aliases in {
    "fx": "flx focalx focallengthx fxdepth depthfx",
    "fy": "fly focaly focallengthy fydepth depthfy",
    "u0": "cx ppx principalpointx mxdepth cxdepth depthcx",
    "v0": "cy ppy principalpointy mydepth cydepth depthcy",
    "width": "imagewidth imgwidth w depthwidth",
    "height": "imageheight imgheight h depthheight",
    "size": "resolution imagesize imgsize framesize",
    "matrix": "k intrinsics intrinsic intrinsicmatrix cameramatrix cameraintrinsics cameraintrinsic depthintrinsics "
              "depthintrinsic camk camerak depthk kdepth mtx intrinsicsmatrix intrinsicparameters "
              "depthintrinsicmatrix depthcameramatrix",
    "rate": "fps framerate",
    "scale": "depthscale depthunits pngdepthscale depthmapfactor",
    "coefficients": "coeffs d dist distcoeff distcoeffs distcoefs distcoef distortioncoefficients distortioncoeffs "
                    "distortioncoeff distortionparameters distortionparams depthdistortion",
    "model": "distortionmodel",
    "name": "cameraname",
}.items() for alias in (key, *aliases.split())}
IN_METRES, PER_METRE = 0.01, 100.0  # a depth scale below, and from here on
KINDS = [re.compile(kind, re.I) for kind in ("depth", "infra|(?<![a-z])ir(?![a-z])", "colou?r|rgb")]
UNNAMED = 2  # rank of a camera whose names say no kind, before colour
MAX_NAMES = 8  # of unused keys that are named


def since_1970(numbers: Sequence[float]) -> str | None:
    """The unit in which all numbers are times from 2000 to 2100; None without one."""
    for unit, ticks in TICKS.items():
        if all(EPOCH[0] * ticks <= number < EPOCH[1] * ticks for number in numbers):
            return unit
    return None


def find(document: Any, where: str, is_replaced: bool = False) -> Found:
    """The camera in a document of plain values; ``where`` begins errors.

    is_replaced  whether the user gives the camera, so that the document's matrix need not be valid

    Raises DataError.
    """
    if not isinstance(document, dict):
        if not isinstance(document, list) or not _numbers(document):
            form = '{"fx": ..., "fy": ..., "u0": ..., "v0": ...}'
            raise DataError(f"{where}: found {_shown(document)}; expected {form}")
        numbers = _numbers(document) or []
        is_sized = len(numbers) == 6  # fx, fy, cx, cy, width, height
        document = {"matrix": numbers[:4], "size": numbers[4:]} if is_sized else {"matrix": document}
    chosen = _chosen(document) or [(("", document),)]
    found = [Found(chain, where, is_replaced) for chain in chosen]
    if len({one.info for one in found}) > 1:
        names = ", ".join(dict.fromkeys(map(_name_of, chosen)))
        raise DataError(f"{where}: has several cameras: {names}; expected one, or one of depth")
    return found[0]


_Chain = tuple[tuple[str, dict[str, Any]], ...]  # names and objects, from the document to one within it


def _objects(value: Any, outer: _Chain, name: str = "") -> Iterator[_Chain]:
    """All objects in a value, each with those around it."""
    if isinstance(value, dict):
        inner = (*outer, (name, value))
        yield inner
        for key, child in value.items():
            yield from _objects(child, inner, str(key))
    elif isinstance(value, list):
        for child in value:
            yield from _objects(child, outer, name)


def has_camera(values: Mapping[str, Any]) -> bool:
    """True for a focal length, or for numbers in the place of a matrix."""
    return any((key := _key(name)) == "fx" or (key == "matrix" and _numbers(value)) for name, value in values.items())


def is_known(name: str) -> bool:
    """True for a name that is read in an object with a camera."""
    return _key(name) in {*KNOWN, *ALIASES.values()}


def _chosen(document: Any) -> list[_Chain]:
    """The cameras of depth; without one those of infrared, then those that are not of colour, then all."""
    cameras = [chain for chain in _objects(document, ()) if has_camera(chain[-1][1])]
    ranks = [_rank(chain) for chain in cameras]
    return [chain for chain, rank in zip(cameras, ranks) if rank == min(ranks)]


def _rank(chain: _Chain) -> int:
    """The place of a camera in KINDS, by the innermost name that says its kind."""
    for name, _ in reversed(chain):
        for rank, kind in enumerate(KINDS):
            if kind.search(name):
                return rank if rank < UNNAMED else rank + 1
    return UNNAMED


def _name_of(chain: _Chain) -> str:
    return ".".join(name for name, _ in chain if name)


def _key(name: str) -> str:
    """The key of a camera.json, or "matrix", "size", "scale", for a name; itself if it is unknown."""
    if name in KNOWN:
        return name
    return ALIASES.get(re.sub(r"[\W_]", "", name.rpartition(".")[2]).lower(), name)


def unknown_key(key: str, known: Collection[str] = KNOWN) -> str:
    """What is wrong with an unknown key."""
    return f"unknown key {key!r}{did_you_mean(key, known)}; known: {', '.join(known)}"


class Found:
    """The camera in the last object of a chain, with what those around it say. Raises DataError.

    info    the parameters
    fields  for each used key the field of CameraInfo that it gives
    unused  the other keys of the same object
    words   both, for people
    is_own  whether all used keys are those of a camera.json
    """

    def __init__(self, chain: _Chain, where: str, is_replaced: bool) -> None:
        self._where, self._values = where, dict[str, Any]()
        self.fields, self.unused = dict[str, str](), list[str]()
        self._is_replaced = is_replaced
        self._take(chain[-1][1])
        for _, outer in chain[-2::-1]:
            self._take_around(outer)
        more = f"{', '.join(self.unused[:MAX_NAMES])}{' ...' * (len(self.unused) > MAX_NAMES)}"
        self.words = ", ".join(self.fields) + (f"; not used: {more}" if more else "")
        self.is_own = len(chain) < 2 and all(name in KNOWN for name in self.fields)
        self.info = self._info()

    def _refuse(self, what: str) -> NoReturn:
        raise DataError(f"{self._where}: {what}")

    def _take(self, values: Mapping[str, Any]) -> None:
        """Take the values of the object with the camera. Raises DataError."""
        keys = {_key(name) for name in values}
        for name, value in values.items():
            key = _key(name)
            is_second = key == "matrix" and ("fx" in keys or "fx" in self._values)
            if is_second or value is None or not self._is_taken(name, key, value):
                self.unused.append(name)

    def _take_around(self, values: Mapping[str, Any]) -> None:
        """Take what an object around it says of the size, the lens and the frames. Raises DataError."""
        size = {"size", *SIZE} if "width" not in self._values else set()
        lens = set(LENS) if self._values.keys().isdisjoint(LENS) else set()
        wanted = (size | lens | {"scale", "unit_mm", "rate", "time_unit"}) - self._values.keys()
        for name, value in values.items():
            if _key(name) in wanted and value is not None:
                self._is_taken(name, _key(name), value)

    def _is_taken(self, name: str, key: str, value: Any) -> bool:
        """Take a value, if its key is known. Raises DataError."""
        if key == "matrix":
            self.fields[name] = "camera"
            try:
                numbers = _of_matrix(value, f"{self._where}: {name}")
            except DataError:
                if not self._is_replaced:
                    raise
                return True
            for own, number in zip(INTRINSICS, numbers):
                self._set(own, number, name)
        elif key == "size":
            pair = [value.get(one) for one in SIZE] if isinstance(value, dict) else value
            if not isinstance(pair, list) or len(pair) != 2:
                return False
            for own, number in zip(SIZE, pair):
                self._set(own, number, name)
        elif key == "scale":
            if _is_number(value):
                value = 1000 / value if value >= PER_METRE else 1000 * value if value < IN_METRES else value
            self._set("unit_mm", value, name)
        elif key == "distortion" and isinstance(value, dict) and not _numbers(value):
            for inner, number in value.items():
                if (own := _key(inner)) not in LENS[1:]:
                    self._refuse(f"{name}: {unknown_key(inner, LENS[1:])}")
                self._set(own, number, name)
        elif key == "distortion":
            self._set("model" if isinstance(value, str) else "coefficients", value, name)
        elif key in KNOWN:
            self._set(key, value, name)
        else:
            return False
        return True

    def _set(self, key: str, value: Any, name: str) -> None:
        if key in self._values:
            self._refuse(f"says {key} twice" + (f", once as {name}" if key != name else ""))
        self._values[key] = self._checked(key, value)
        self.fields[name] = "lens" if key in LENS else key if key in FIELDS else "camera"

    def _checked(self, key: str, value: Any) -> Any:
        """The value of a key, numbers as such. Raises DataError for one of another kind, or out of range."""
        if key == "coefficients":
            if (numbers := _numbers(value)) is None:
                self._refuse(f"distortion is {_shown(value)}; expected a list of numbers: k1, k2, p1, p2, k3 ...")
            return numbers
        if key == "time_unit":
            if value not in TIME_UNITS:
                self._refuse(f"time_unit is {_shown(value)}; expected {', '.join(TIME_UNITS)}")
            return value
        if key in ("name", "model"):
            if not isinstance(value, str):
                self._refuse(f"{key} is {_shown(value)}; expected a text")
            return value
        low, high = RANGES.get(key, (-math.inf, math.inf))
        if not _is_number(value) or not low < value <= high:
            expected = f"more than {low:g} and at most {high:g}" if key in RANGES else "that is finite"
            self._refuse(f"{key} is {_shown(value)}; expected a number {expected}")
        if key in SIZE and value % 1:
            self._refuse(f"{key} is {value}; expected a whole number")
        return int(value) if key in SIZE else float(value)

    def _info(self) -> CameraInfo:
        """The parameters. Raises DataError."""
        camera, said = None, self._values
        if self._all_or_none(INTRINSICS):
            self._all_or_none(SIZE)
            fx, fy, u0, v0, width, height = (said.get(key, 0) for key in (*INTRINSICS, *SIZE))
            near = said.get(MIN_RANGE, MIN_RANGE_MM)
            camera = Camera(said.get("name", "own"), fx, fy, u0, v0, width, height, near)
        elif stray := [key for key in (*SIZE, "name", MIN_RANGE) if key in said]:
            self._refuse(f"has {stray[0]}, but not fx, fy, u0, v0")
        unit_mm, rate, time_unit = (said.get(key) for key in FIELDS)
        return CameraInfo(camera, self._lens(), unit_mm, rate, self._where, time_unit)

    def _lens(self) -> Lens | None:
        said = self._values
        by_name = [said.get(key, 0.0) for key in BROWN] if not said.keys().isdisjoint(BROWN) else []
        if by_name and "coefficients" in said:
            self._refuse("says the distortion twice, once as k1 ... or p1 ...")
        if not (by_name or "coefficients" in said or "model" in said):
            return None
        return lens_of(said.get("model", "brown_conrady"), said.get("coefficients", by_name), self._where)

    def _all_or_none(self, keys: tuple[str, ...]) -> bool:
        """True if all of the keys are present, False if none is; raises DataError otherwise."""
        missing = [key for key in keys if key not in self._values]
        if missing and len(missing) < len(keys):
            there = next(key for key in keys if key in self._values)
            self._refuse(f"has {there}, but not {' and '.join(missing)}")
        return not missing


def _of_matrix(value: Any, where: str) -> list[float]:
    """fx, fy, u0, v0 of a matrix by rows or by columns, or of these four numbers. Raises DataError."""
    numbers = _numbers(value) or []
    if len(numbers) == 4:
        return numbers
    for width in (3, 4) if len(numbers) in (9, 12, 16) else ():
        if len(numbers) % width:
            continue
        rows = np.reshape(numbers, (-1, width))
        for matrix in (rows, rows.T):
            expected = np.eye(*matrix.shape)
            expected[0, [0, 2]], expected[1, [1, 2]] = matrix[0, [0, 2]], matrix[1, [1, 2]]
            if np.array_equal(matrix, expected):
                return [float(number) for number in (*expected[[0, 1], [0, 1]], *expected[:2, 2])]
    raise DataError(f"{where} is {_shown(value)}; expected [[fx, 0, cx], [0, fy, cy], [0, 0, 1]], or fx, fy, cx, cy")


def _numbers(value: Any) -> list[float] | None:
    """The numbers in lists, or in the data of an object with rows and columns; None for anything else."""
    if isinstance(value, dict):
        return _numbers(value["data"]) if isinstance(value.get("data"), list) else None
    if not isinstance(value, list):
        return None
    found: list[float] = []
    for one in value:
        inner = [float(one)] if _is_number(one) else _numbers(one)
        if inner is None:
            return None
        found += inner
    return found


def _is_number(value: object) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool) and abs(value) < 1e300


def _shown(value: object) -> str:
    text = json.dumps(value)
    return text if len(text) <= 40 else f"{text[:40]} ..."
