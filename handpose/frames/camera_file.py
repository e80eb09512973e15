"""camera.json: the parameters of a depth camera, next to its frames or within their file; other
files with a camera.

{"fx": 476.0, "fy": 476.0, "u0": 313.7, "v0": 242.8, "width": 640, "height": 480, "unit_mm":
0.125, "rate": 30,
 "distortion": {"model": "brown_conrady", "coefficients": [0.1, -0.2, 0, 0, 0]}}

fx, fy, u0, v0  px, all four or none; cx, cy and ppx, ppy are other names of u0, v0
width, height   px of the frames, both or none
unit_mm         depth of a stored value of 1 in mm; RealSense's depth_scale is in metres
rate            frames per second; also fps
min_range_mm    nearer readings are errors and count as missing; default 200
distortion      of the lens: as above, or the coefficients alone; model, coeffs, k1 ... p2 may also
                be keys next to fx
name            of the camera
time_unit       of the times in the names of the frames or in their file: s, ms, us, ns, or
                frames for numbers

Files of other programs are read by the same keys under the names in ``ALIASES``, whatever their
form: JSON, the YAML in which programs write parameters, lines of keys and values, sections, or
tables of numbers. In them

    fx, fy, cx, cy  are also a matrix: 3 x 3 by rows or by columns, within 3 x 4 or 4 x 4, or fx,
                    fy, cx, cy in a row
    width, height   both in a row, as in resolution: [640, 480] or 640x480
    depth_scale     of a stored value of 1: m, if it is less than 0.01; otherwise mm; from 100 on
                    stored values per m

They may lie within other objects and lists, and have names such as Camera.fx. Of several cameras
that of the depth is taken, by the names around it and the texts in it, and of several modes of it
that of the frames' size.
"""

from __future__ import annotations

import contextlib
import json
import re
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NoReturn

import numpy as np

from handpose.frames.cameras import MIN_FOCAL_PX, MIN_RANGE_MM, Camera, View
from handpose.frames.lens import Lens, lens_of
from handpose.frames.recording import CameraInfo
from netlib import files
from netlib.errors import DataError, did_you_mean, reason_of
from netlib.files import atomic

NAME = "camera.json"
WIDE_BOMS = (b"\xff\xfe", b"\xfe\xff")
MAX_BYTES = 1 << 22  # of a file; calibrations have some 10,000


def read(path: Path) -> CameraInfo:
    """Read a camera.json, or a file of another program. Raises DataError."""
    content = files.read_bytes(path, "the camera", limit=MAX_BYTES)
    is_wide = content[:2] in WIDE_BOMS  # as PowerShell redirects texts
    try:
        text = content.decode("utf-16" if is_wide else "utf-8-sig")
    except UnicodeDecodeError as error:
        raise DataError(f"{path}: cannot read the camera: {reason_of(error)}") from error
    return parse(text, str(path))


def write(path: Path, given: CameraInfo) -> None:
    """Write a camera.json atomically. Raises OSError."""
    atomic.replace_text(path, to_text(given) + "\n")


def to_text(given: CameraInfo) -> str:
    """The text that ``parse`` reads, without loss of precision."""
    known = vars(given.camera) if isinstance(given.camera, Camera) else {}
    known = known | vars(given)
    keys = [key for key in (*CAMERA, *FIELDS) if known.get(key) not in (None, DEFAULTS.get(key))]
    said = {key: known[key] for key in keys}
    if given.lens is not None and not given.lens.is_straight:
        said["distortion"] = vars(given.lens)
    return json.dumps(said, indent=1, default=float)


def parse(text: str, where: str) -> CameraInfo:
    """Parse the text of a camera.json or of another file; ``where`` begins every error.

    Raises DataError.
    """
    try:
        found = find(parse_document(text, where), where)
    except RecursionError:  # thousands of brackets
        raise DataError(f"{where}: not the parameters of a camera") from None
    if found.unused and (found.is_own or found.info.camera is None):
        raise DataError(f"{where}: {unknown_key(found.unused[0])}")
    return found.info if found.is_own else replace(found.info, origin=f"{where} ({found.words})")


# ---------------------------------------------------------------------------------------- documents

NUMBER = r"[-+]?(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][-+]?\d+)?"
# in any brackets, as print writes them
NUMBERS = rf"[\[\](),;\s]*{NUMBER}(?:[\[\](),;\s]+{NUMBER})*[\[\](),;\s]*"
KEY = r"""("[^"]+"|'[^']+'|(?<!\w)[A-Za-z_][\w./ \t]{0,60}?(?:\([^)]*\))?)\s*"""
TEXT = r"""("[^"]*"|'[^']*'|(?![^,;]*[:=])[^\s\[{"'!,;][^,;{}\[\]<>()]*)"""
TABLE = re.compile(NUMBERS)
# a line may have several
PAIR = re.compile(rf"{KEY}[:=]\s*(?:(?:array)?({NUMBERS})(?![\w.])|{TEXT})")
COLUMNS = re.compile(rf"^\s*{KEY}(?:[\s,]\s*({NUMBERS})(?:px|pixels)?|,\s*{TEXT})\s*$")
JSON = re.compile(r'\s*(\{\s*["}]|\[\s*[\[{"]|$)')
EDGES = " \t<({[]\"'"  # of a name
# What is replaced in this order: comments; other documents than the first; empty lines; dashes of
# elements; what print shows of pyrealsense2's intrinsics, and of pyorbbecsdk's; ends of lines
# before numbers that continue them; products.
REPLACEMENTS = {
    r"(?m)(?:^|(?<=\s))#.*|^%.*": "",
    r"(?ms)(?<=\S)\s*^(?:---|\.\.\.)\s*$.*|^---\s*$": "",
    r"(?<!\s)\s*\n": "\n",
    r"(?<!\S)-(?!\S)": " ",
    rf"\[\s*({NUMBER})\s*x\s*({NUMBER})\s+p\[({NUMBER}) ({NUMBER})\]\s+f\[({NUMBER}) ({NUMBER})\]"
    r"\s+([\w ]+?) *\[([^\]]*)\]\s*\]": r" width: \1, height: \2, u0: \3, v0: \4, fx: \5, "
    r"fy: \6, model: \7, coefficients: [\8]",
    r"(?m)^([<\t ]*\w+) (?=\w+[:=].*[:=])": r"\1: ",
    r"(?m)\n[ \t]*(?=[\[(]+[ \t]*[-+.\d]|[-+.\d][-+\d.eE,;\t \])]*$)": " ",
    r"(?<=\d)[ \t]*x[ \t]*(?=\d)": ", ",
}


def parse_document(text: str, where: str) -> Any:
    """The value of a text, which its content decides: of a table the list of its numbers.

    ``where`` begins errors.

    Raises DataError.
    """
    plain = text
    for form, usual in REPLACEMENTS.items():
        plain = re.sub(form, usual, plain)
    if TABLE.fullmatch(plain):
        return _value(f"[{plain}]")
    if JSON.match(text):
        return parsed(text, where)
    if re.match(r"\s*\{'", text):  # a dictionary as Python prints it
        with contextlib.suppress(DataError):
            return parsed(text.replace("'", '"'), where)
    if re.match(r"\s*<(\?xml|opencv)", text):
        expected = "expected JSON or YAML, which OpenCV's FileStorage writes, too"
        raise DataError(f"{where}: XML; {expected}")
    return _of_lines(plain, where)


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
    # of a text that is cut, or of integers of thousands of digits
    except ValueError as error:
        raise DataError(f"{where}: not whole JSON: {error}") from None


def _of_lines(text: str, where: str) -> dict[str, Any]:
    """The keys and values in lines. Raises DataError for a known key given twice.

    A name without a value is that of the object of what begins in a later column, or of all lines
    of a section. Blocks of the same name differ by spaces.
    """
    document: dict[str, Any] = {}
    # the items around the next one: the column and the object of each, and its key there
    around = [(-2, {"": document}, "")]
    for column, name, value in _items(text):
        while around[-1][0] >= column:
            around.pop()
        _, inside, key = around[-1]
        above = inside[key]
        if above is None:
            above = inside[key] = {}
        if isinstance(above, dict):
            inside = above
        key = name
        while key in inside:
            if value is not None and is_known(name):
                raise DataError(f"{where}: has {name!r} twice")
            key += " "
        inside[key] = value
        around.append((column, inside, key))
    if not document:
        raise DataError(f"{where}: not the parameters of a camera")
    return document


def _items(text: str) -> Iterator[tuple[int, str, Any]]:
    """The column, name and value of what is in each line: a section or another name, with None;
    keys with their values, after the name before them.
    """
    for line in text.splitlines():
        found = list(PAIR.finditer(line)) or list(COLUMNS.finditer(line))
        head = line[: found[0].start(1)] if found else line
        name = re.split("[:=]", head)[0].strip(EDGES)
        if name and not TABLE.fullmatch(name):
            yield -1 if head.startswith("[") else len(head) - len(head.lstrip()), name, None
        for pair in found:
            yield pair.start(1), pair[1].strip("\"'"), _value(pair[2] or pair[3])


def _value(text: str) -> Any:
    """A number, the list of several numbers or of those in brackets, or a text."""
    if not TABLE.fullmatch(text):
        return text.strip(" \t\"'")
    numbers = [float(number) for number in re.findall(NUMBER, text)]
    return numbers if len(numbers) > 1 or "[" in text else numbers[0]


# ------------------------------------------------------------------------------------------- values

BROWN = ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")  # in OpenCV's order
RANGES = {  # exclusive lower and inclusive upper bounds
    "fx": (MIN_FOCAL_PX, 1e6),
    "fy": (MIN_FOCAL_PX, 1e6),
    "u0": (-1e6, 1e6),
    "v0": (-1e6, 1e6),
    "unit_mm": (1e-6, 1e4),
    "rate": (1e-6, 1e4),
    "width": (0, 1 << 14),
    "height": (0, 1 << 14),
    "min_range_mm": (0, 1e4),
} | dict.fromkeys(BROWN, (-1e300, 1e300))
MIN_RANGE = "min_range_mm"
TICKS = {"s": 1, "ms": 10**3, "us": 10**6, "ns": 10**9}  # per second, of the units of times
FRAME_UNIT = "frames"  # the unit of numbers that count frames
TIME_UNITS = (*TICKS, FRAME_UNIT)
EPOCH = (946684800, 4102444800)  # s since 1970 of the years 2000 and 2100
INTRINSICS, SIZE_KEYS = ("fx", "fy", "u0", "v0"), ("width", "height")
CAMERA = (*SIZE_KEYS, *INTRINSICS, "name", MIN_RANGE)  # the keys of a camera, and their defaults
DEFAULTS: dict[str, Any] = {"width": 0, "height": 0, "name": "own", MIN_RANGE: MIN_RANGE_MM}
LENS = ("distortion", "model", *BROWN)
IN_LENS = ("model", "coefficients", *BROWN)  # the keys of an object of a distortion
FIELDS = ("unit_mm", "rate", "time_unit")  # those that are fields of CameraInfo
KNOWN = (
    *RANGES,
    "name",
    "distortion",
    "model",
    "coefficients",
    "time_unit",
)  # the keys of a camera.json
ROWS = {"focal": ("fx", "fy"), "middle": ("u0", "v0"), "size": SIZE_KEYS}  # keys of two values
# what the objects around a camera say for it, unless it says one of the same group
AROUND = (("size", *SIZE_KEYS), LENS, ("scale", "unit_mm"), ("rate",), ("time_unit",))
MATRIX = "[[fx, 0, cx], [0, fy, cy], [0, 0, 1]], or fx, fy, cx, cy"
MATRIX_SHAPES = {9: (3, 3), 12: (3, 4), 16: (4, 4)}  # of matrices, by the number of their elements
PLACES = ([0, 1, 0, 1], [0, 1, 2, 2])  # of fx, fy, u0, v0 in a matrix
# A key in each line, and other names, without capitals and without what is no letter or digit.
KEY_NAMES = """\
unit_mm unitmm
min_range_mm minrangemm
time_unit timeunit
fx flx focalx focallengthx fxdepth depthfx
fy fly focaly focallengthy fydepth depthfy
u0 cx ppx principalpointx mxdepth cxdepth depthcx
v0 cy ppy principalpointy mydepth cydepth depthcy
focal focallength focallengths
middle principalpoint opticalcenter
width imagewidth imgwidth w depthwidth mdepthwidth resolutionwidth resolutionx framewidth
height imageheight imgheight h depthheight mdepthheight resolutionheight resolutiony frameheight
size resolution imagesize imgsize framesize imageresolution
matrix k intrinsics intrinsic intrinsicmatrix cameramatrix cameraintrinsics cameraintrinsic
matrix depthintrinsics depthintrinsic cammat camk camerak depthk kdepth mtx intrinsicsmatrix
matrix intrinsicparameters kmatrix depthintrinsicmatrix depthcameramatrix camintrinsics
matrix camintrinsic mcalibrationdepthintrinsic intrinsicdepth intrinsicsdepth calibrationmatrix
matrix cameraintrinsicmatrix cameraintrinsicsmatrix
rate fps framerate
scale depthscale depthunits pngdepthscale depthmapfactor depthfactor mdepthshift
distortion coefficients coeffs d dist distcoeff distcoeffs distcoefs distcoef distortioncoefficients
distortion distortioncoeffs distortioncoeff distortionparameters distortionparams depthdistortion
model distortionmodel distortiontype distorsion
name cameraname
k1
k2
p1
p2
k3
k4
k5
k6
"""
ALIASES = {
    alias: key
    for key, *aliases in map(str.split, KEY_NAMES.splitlines())
    for alias in (key, *aliases)
}
IN_METRES, PER_METRE = 0.01, 100.0  # a depth scale below, and from here on
# Ranks of cameras: of depth, of infrared, whose names say no kind, of colours.
UNNAMED, COLOUR = 2, 3
KINDS = {0: "depth", 1: "infra|(?<![a-z])ir(?![a-z])", COLOUR: "colou?r|rgb"}
MAX_NAMES = 8  # of unused keys, or arrays, that are named


def since_1970(numbers: Sequence[float]) -> str | None:
    """The unit in which all numbers are times from 2000 to 2100; None without one."""
    for unit, ticks in TICKS.items():
        if all(EPOCH[0] * ticks <= number < EPOCH[1] * ticks for number in numbers):
            return unit
    return None


def find(document: Any, where: str, is_replaced: bool = False) -> FoundCamera:
    """The camera in a document of plain values; ``where`` begins errors.

    is_replaced  whether the user gives the camera, so that the document's matrix need not be valid

    Raises DataError.
    """
    if not isinstance(document, dict):
        numbers = _numbers(document)
        if not numbers:
            form = '{"fx": ..., "fy": ..., "u0": ..., "v0": ...}'
            raise DataError(f"{where}: found {_shown(document)}; expected {form}")
        is_sized = len(numbers) == 6  # fx, fy, cx, cy, width, height
        sized = {"matrix": numbers[:4], "size": numbers[4:]}
        document = sized if is_sized else {"matrix": document}
    chains = [chain for chain in _objects(document, []) if has_camera(chain[-1][1])]
    chains = chains or [[("", document)]]
    ranks = [
        rank_of(*(name for name, _ in chain), *map(str, chain[-1][1].values())) for chain in chains
    ]
    chosen = [chain for chain, rank in zip(chains, ranks) if rank == min(ranks)]
    found = [FoundCamera(chain, where, is_replaced) for chain in chosen]
    if len({one.info for one in found}) > 1:
        found[0].info = _of_modes(found, where)
    return found[0]


# names and objects, from the document to one within it
_Chain = list[tuple[str, dict[str, Any]]]


def _of_modes(found: Sequence[FoundCamera], where: str) -> CameraInfo:
    """Cameras that differ in the size of their frames alone, as one.

    Raises DataError for others.
    """
    infos = dict.fromkeys(one.info for one in found)
    cameras = [info.camera for info in infos if isinstance(info.camera, Camera)]
    modes = {(camera.width, camera.height): camera for camera in cameras}
    common, *others = {replace(info, camera=None) for info in infos}
    if len(modes) < len(infos) or (0, 0) in modes or others:
        names = ", ".join(dict.fromkeys(one.name for one in found))
        raise DataError(f"{where}: has several cameras: {names}; expected one, or one of depth")

    def at(width: int, height: int) -> Camera:
        if (width, height) not in modes:
            known = ", ".join(f"{w} x {h}" for w, h in modes)
            raise DataError(f"{width} x {height} pixels; {where} has a camera for {known}")
        return modes[width, height]

    # without a lens it would be one by its field of view
    view = View("own", at, tuple(modes))
    return replace(common, camera=view, lens=common.lens or Lens())


def _objects(value: Any, outer: _Chain, name: str = "") -> Iterator[_Chain]:
    """All objects in a value, each with those around it."""
    if isinstance(value, dict):
        inner = [*outer, (name, value)]
        yield inner
        for key, child in value.items():
            yield from _objects(child, inner, str(key))
    elif isinstance(value, list):
        for child in value:
            yield from _objects(child, outer, name)


def has_camera(values: Mapping[str, Any]) -> bool:
    """True for a focal length, or for numbers in the place of a matrix."""
    return any(
        (key := _key(name)) == "fx" or (key in ("matrix", "focal") and _numbers(value))
        for name, value in values.items()
    )


def is_known(name: str) -> bool:
    """True for a name that is read in an object with a camera."""
    return _key(name) in ALIASES.values()


def rank_of(*names: str) -> int:
    """The rank of a camera among others, 0 for depth, by the innermost name that says its kind."""
    for name in reversed(names):
        for rank, kind in KINDS.items():
            if re.search(kind, name, re.I):
                return rank
    return UNNAMED


def _key(name: str, value: Any = None) -> str:
    """The key of a camera.json, or one of those in ``KEY_NAMES`` alone, for a name; itself if
    it is unknown.

    A value with a width and a height alone is a size under any name.
    """
    if isinstance(value, dict) and {_key(one) for one in value} == {*SIZE_KEYS}:
        return "size"
    return ALIASES.get(re.sub(r"[\W_]", "", name.rpartition(".")[2]).lower(), name)


def unknown_key(key: str, known: Collection[str] = KNOWN) -> str:
    """What is wrong with an unknown key."""
    return f"unknown key {key!r}{did_you_mean(key, known)}; known: {', '.join(known)}"


class FoundCamera:
    """The camera in the last object of a chain, with what those around it say. Raises DataError.

    info    the parameters
    name    of the object
    fields  for each used key the field of CameraInfo that it gives
    unused  the other keys of the same object
    words   both, for people
    is_own  whether all used keys are those of a camera.json
    """

    def __init__(self, chain: _Chain, where: str, is_replaced: bool) -> None:
        self._where, self._is_replaced = where, is_replaced
        self._values, self.fields = dict[str, Any](), dict[str, str]()
        own = chain[-1][1]
        wanted = {*ALIASES.values()}
        if any(_key(name) == "fx" for name in own):  # of two forms the matrix is not used
            wanted -= {"matrix"}
        for _, values in reversed(chain):
            for name, value in values.items():
                if value is not None and _key(name, value) in wanted:
                    self._take(name, value)
            said = self._values.keys()
            wanted = {key for group in AROUND if said.isdisjoint(group) for key in group}
        self.name = ".".join(name.strip() for name, _ in chain if name)
        self.unused = [name for name in own if name not in self.fields]
        others = ", ".join(self.unused[:MAX_NAMES]) + " ..." * (len(self.unused) > MAX_NAMES)
        self.words = ", ".join(self.fields) + f"; not used: {others}" * bool(others)
        self.is_own = len(chain) < 2 and self.fields.keys() <= {*KNOWN}
        self.info = self._info()

    def _refuse(self, what: str) -> NoReturn:
        raise DataError(f"{self._where}: {what}")

    def _take(self, name: str, value: Any) -> None:
        """Take what the value of a known name says. Raises DataError."""
        for key, plain in self._plain(name, value).items():
            if key in self._values:
                self._refuse(f"says {key} twice, once as {name}")
            self._values[key] = self._checked(key, plain)
            self.fields[name] = "lens" if key in LENS else key if key in FIELDS else "camera"

    def _plain(self, name: str, value: Any) -> dict[str, Any]:
        """The values of keys of a camera.json that a name and its value mean. Raises DataError."""
        key = _key(name, value)
        is_object = isinstance(value, dict)
        inner = {_key(one): number for one, number in value.items()} if is_object else {}
        if key == "matrix":
            self.fields[name] = "camera"
            four = _of_matrix(_numbers(value) or [])
            if not four and not self._is_replaced:
                self._refuse(f"{name} is {_shown(value)}; expected {MATRIX}")
            return dict(zip(INTRINSICS, four))
        if key in ROWS:
            row = [inner.get(one) for one in ROWS[key]] if inner else value
            return dict(zip(ROWS[key], row)) if isinstance(row, list) and len(row) == 2 else {}
        if key == "distortion" and is_object and not _numbers(value):
            if strange := [one for one in inner if one not in LENS]:
                self._refuse(f"{name}: {unknown_key(strange[0], IN_LENS)}")
            return inner
        if key == "distortion" and isinstance(value, str):
            key = "model"
        if key == "scale":
            key = "unit_mm"
            if _is_number(value) and not IN_METRES <= value < PER_METRE:
                value = 1000 * value if value < IN_METRES else 1000 / value
        return {key: value}

    def _checked(self, key: str, value: Any) -> Any:
        """The value of a key, numbers as such.

        Raises DataError for one of another kind, or out of range.
        """
        plain: Any = value if isinstance(value, str) else None
        expected = "a text"
        if key == "distortion":
            plain, expected = _numbers(value), "a list of numbers: k1, k2, p1, p2, k3 ..."
        elif key == "time_unit":
            plain, expected = plain if plain in TIME_UNITS else None, ", ".join(TIME_UNITS)
        elif key in RANGES:
            low, high = RANGES[key]
            plain = float(value) if _is_number(value) and low < value <= high else None
            expected = f"a number more than {low:g} and at most {high:g}"
            if plain and key in SIZE_KEYS:
                plain, expected = int(plain) if plain.is_integer() else None, "a whole number"
        if plain is None:
            self._refuse(f"{key} is {_shown(value)}; expected {expected}")
        return plain

    def _info(self) -> CameraInfo:
        """The parameters. Raises DataError."""
        said = self._values
        there = [key for key in CAMERA if key in said]
        needed = (*SIZE_KEYS, *INTRINSICS) if there and there[0] in SIZE_KEYS else INTRINSICS
        missing = [key for key in needed if key not in said]
        if there and missing:
            names = (" and " if len(missing) < len(INTRINSICS) else ", ").join(missing)
            self._refuse(f"has {there[0]}, but not {names}")
        values = DEFAULTS | {key: said[key] for key in there}
        camera = Camera(**values) if there else None
        if said.keys() & BROWN:
            if "distortion" in said:
                self._refuse("says the distortion twice, once as k1 ... or p1 ...")
            said["distortion"] = [said.get(key, 0.0) for key in BROWN]
        lens = None
        if said.keys() & {"distortion", "model"}:
            model = said.get("model", "brown_conrady")
            lens = lens_of(model, said.get("distortion", []), self._where)
        fields: dict[str, Any] = {key: said.get(key) for key in FIELDS}
        return CameraInfo(camera, lens, origin=self._where, **fields)


def _of_matrix(numbers: list[float]) -> list[float]:
    """fx, fy, u0, v0 of a matrix by rows or by columns, or of these four; none of others."""
    if len(numbers) == 4:
        return numbers
    for order in ("C", "F") if len(numbers) in MATRIX_SHAPES else ():
        matrix = np.reshape(numbers, MATRIX_SHAPES[len(numbers)], order)
        expected = np.eye(*matrix.shape)
        expected[PLACES] = matrix[PLACES]
        if np.array_equal(matrix, expected):
            return [float(number) for number in matrix[PLACES]]
    return []


def _numbers(value: Any) -> list[float] | None:
    """The numbers in lists, or in the data of an object with rows and columns; None for
    anything else.
    """
    if isinstance(value, dict):
        value = value.get("data")
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
