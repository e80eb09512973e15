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

import codecs
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
MAX_BYTES = 1 << 22  # of a file; calibrations have some 10,000


def read(path: Path) -> CameraInfo:
    """Read a camera.json, or a file of another program. Raises DataError."""
    content = files.read_bytes(path, "the camera", limit=MAX_BYTES)
    # as PowerShell redirects texts
    is_wide = content.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE))
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
    said: dict[str, Any] = {}
    if isinstance(given.camera, Camera):
        said |= {"name": given.camera.name} | {
            key: float(getattr(given.camera, key)) for key in INTRINSICS
        }
        if given.camera.width:
            said |= {key: int(getattr(given.camera, key)) for key in SIZE}
        if given.camera.min_range_mm != MIN_RANGE_MM:
            said[MIN_RANGE] = float(given.camera.min_range_mm)
    said |= {
        key: float(getattr(given, key))
        for key in ("unit_mm", "rate")
        if getattr(given, key) is not None
    }
    if given.lens is not None and not given.lens.is_straight:
        said["distortion"] = {
            "model": given.lens.model,
            "coefficients": list(map(float, given.lens.coefficients)),
        }
    if given.time_unit is not None:
        said["time_unit"] = given.time_unit
    return json.dumps(said, indent=1)


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
TABLE, SECTION = re.compile(NUMBERS), re.compile(r"\[([A-Za-z][^\[\]{},:\"]*)\]")
# a line may have several
PAIR = re.compile(rf"{KEY}[:=]\s*(?:(?:array)?({NUMBERS})(?![\w.])|{TEXT})")
COLUMNS = re.compile(rf"{KEY}(?:[\s,]\s*({NUMBERS})(?:px|pixels)?|,\s*{TEXT})")
PRINTED = re.compile(  # what print shows of pyrealsense2's intrinsics
    rf"\[\s*({NUMBER}), ({NUMBER})\s+p\[({NUMBER}) ({NUMBER})\]\s+f\[({NUMBER}) ({NUMBER})\]"
    r"\s+([\w ]+?) *\[([^\]]*)\]\s*\]"
)
AS_PAIRS = r" width: \1, height: \2, u0: \3, v0: \4, fx: \5, fy: \6, model: \7, coefficients: [\8]"
PRODUCT, JSON = (
    re.compile(r"(?<=\d)[ \t]*x[ \t]*(?=\d)"),
    re.compile(r'\s*(\{\s*["}]|\[\s*[\[{"]|$)'),
)
COMMENT, ELEMENT = re.compile(r"(?:^|(?<=\s))#.*", re.M), re.compile(r"\s*(?:-(?:\s+|$))*")
EDGES = " \t<({[\"'"  # of a name
BRACKETS = re.compile(r"\[[^\[\]]*(?:\[[^\[\]]*\][^\[\]]*)*\]")


def parse_document(text: str, where: str) -> Any:
    """The value of a text, which its content decides: of a table the list of its numbers.

    ``where`` begins errors.

    Raises DataError.
    """
    plain = COMMENT.sub("", text)
    if TABLE.fullmatch(plain):
        return _value(f"[{plain}]")
    if JSON.match(text):
        return parsed(text, where)
    if text.lstrip().startswith("{'"):  # a dictionary as Python prints it
        with contextlib.suppress(DataError):
            return parsed(text.replace("'", '"'), where)
    if text.lstrip().startswith(("<?xml", "<opencv")):
        raise DataError(
            f"{where}: XML; expected JSON or YAML, which OpenCV's FileStorage writes, too"
        )
    plain = PRINTED.sub(AS_PAIRS, PRODUCT.sub(", ", plain))
    return _of_lines(BRACKETS.sub(lambda found: " ".join(found[0].split()), plain), where)


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
    """The keys and values in lines, of the first document of several. Raises DataError for a known
    key given twice.

    A line without a value names the object of deeper lines, or of all lines of a section; so does
    what is before several keys in a line. Numbers alone continue the value above.
    """
    document: dict[str, Any] = {}
    around = [(-2, document)]  # the objects around a line, each with the indent of its name
    # of the last key: its indent, and the object in which it is
    above, inside, key = -2, document, ""
    for line in text.splitlines():
        content = ELEMENT.sub("", line, count=1).strip()
        if document and content in ("---", "..."):
            break
        if not content or content == "---" or line.startswith("%"):
            continue
        indent, value = line.index(content), inside.get(key, "")
        if TABLE.fullmatch(content):
            if not isinstance(value, (str, dict)):
                row = [] if value is None else value if isinstance(value, list) else [value]
                row += _value(f"[{content}]")
                inside[key] = row if len(row) > 1 or "-" in line[:indent] else row[0]
            continue
        if key and indent > above and value is None:
            inside[key] = {}
            around.append((above, inside[key]))
        section = SECTION.fullmatch(content)
        name, values = ("", [(section[1], None)]) if section else _keys_in(content)
        indent = -1 if section else indent
        while around[-1][0] >= indent:
            around.pop()
        above, inside = indent, around[-1][1]
        if name:
            inside = inside.setdefault(_unique(name, inside), {})
        for key, value in values:
            if key in inside and value is not None and is_known(key):
                raise DataError(f"{where}: has {key!r} twice")
            key = _unique(key, inside)
            inside[key] = value
    if not document:
        raise DataError(f"{where}: not the parameters of a camera")
    return document


def _unique(name: str, inside: Mapping[str, Any]) -> str:
    """A name that an object does not have; blocks of the same name differ by spaces."""
    while name in inside:
        name += " "
    return name


def _keys_in(content: str) -> tuple[str, list[tuple[str, Any]]]:
    """The name before the keys in a line, and these with their values; a name alone is a
    key with None.
    """
    found = list(PAIR.finditer(content))
    if not found and (whole := COLUMNS.fullmatch(content)):
        found = [whole]
    if not found:
        return "", [(re.split("[:=]", content)[0].strip(EDGES), None)]
    before = content[: found[0].start()]
    keys = [pair[1].strip("\"'") for pair in found]
    if len(keys) > 1 and not is_known(keys[0]):  # <Intrinsic fx=60 fy=61 ...
        more, _, last = keys[0].rpartition(" ")
        before, keys[0] = (before + more, last) if is_known(last) else (before, keys[0])
    values = [_value(pair[2] or pair[3]) for pair in found]
    return re.split("[:=]", before)[0].strip(EDGES), list(zip(keys, values))


def _value(text: str) -> Any:
    """A number, the list of several numbers or of those in brackets, or a text."""
    if not TABLE.fullmatch(text):
        return text.strip(" \t\"'")
    numbers = [float(number) for number in re.findall(NUMBER, text)]
    return numbers if len(numbers) > 1 or "[" in text else numbers[0]


# ------------------------------------------------------------------------------------------- values

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
ROWS = {"focal": ("fx", "fy"), "middle": ("u0", "v0"), "size": SIZE}  # keys of two values
# Other names, without capitals and without what is no letter or digit.
ALIASES = {key.replace("_", ""): key for key in KNOWN} | {
    alias: key
    for key, aliases in {
        "fx": "flx focalx focallengthx fxdepth depthfx",
        "fy": "fly focaly focallengthy fydepth depthfy",
        "u0": "cx ppx principalpointx mxdepth cxdepth depthcx",
        "v0": "cy ppy principalpointy mydepth cydepth depthcy",
        "focal": "focallength focallengths",
        "middle": "principalpoint opticalcenter",
        "width": "imagewidth imgwidth w depthwidth mdepthwidth resolutionwidth resolutionx framewidth",
        "height": "imageheight imgheight h depthheight mdepthheight resolutionheight resolutiony frameheight",
        "size": "resolution imagesize imgsize framesize imageresolution",
        "matrix": "k intrinsics intrinsic intrinsicmatrix cameramatrix cameraintrinsics cameraintrinsic "
        "depthintrinsics "
        "depthintrinsic cammat camk camerak depthk kdepth mtx intrinsicsmatrix intrinsicparameters kmatrix "
        "depthintrinsicmatrix depthcameramatrix camintrinsics camintrinsic mcalibrationdepthintrinsic "
        "intrinsicdepth intrinsicsdepth calibrationmatrix cameraintrinsicmatrix cameraintrinsicsmatrix",
        "rate": "fps framerate",
        "scale": "depthscale depthunits pngdepthscale depthmapfactor depthfactor mdepthshift",
        "coefficients": "coeffs d dist distcoeff distcoeffs distcoefs distcoef distortioncoefficients distortioncoeffs "
        "distortioncoeff distortionparameters distortionparams depthdistortion",
        "model": "distortionmodel distortiontype distorsion",
        "name": "cameraname",
    }.items()
    for alias in (key, *aliases.split())
}
IN_METRES, PER_METRE = 0.01, 100.0  # a depth scale below, and from here on
KINDS = [re.compile(kind, re.I) for kind in ("depth", "infra|(?<![a-z])ir(?![a-z])", "colou?r|rgb")]
UNNAMED, COLOUR = 2, 3  # ranks of a camera whose names say no kind, and of one of colours
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
        document = (
            {"matrix": numbers[:4], "size": numbers[4:]} if is_sized else {"matrix": document}
        )
    chains = [chain for chain in _objects(document, ()) if has_camera(chain[-1][1])]
    ranks = [
        rank_of(*(name for name, _ in chain), *map(str, chain[-1][1].values())) for chain in chains
    ]
    chosen = [chain for chain, rank in zip(chains, ranks) if rank == min(ranks)] or [
        (("", document),)
    ]
    found = [Found(chain, where, is_replaced) for chain in chosen]
    if len({one.info for one in found}) > 1:
        found[0].info = _of_modes(chosen, [one.info for one in found], where)
    return found[0]


# names and objects, from the document to one within it
_Chain = tuple[tuple[str, dict[str, Any]], ...]


def _of_modes(chains: list[_Chain], infos: list[CameraInfo], where: str) -> CameraInfo:
    """Cameras that differ in the size of their frames alone, as one.

    Raises DataError for others.
    """
    cameras = dict.fromkeys(info.camera for info in infos)
    modes = {(one.width, one.height): one for one in cameras if isinstance(one, Camera)}
    others = {replace(info, camera=None) for info in infos}
    if len(modes) < len(cameras) or (0, 0) in modes or len(others) > 1:
        names = dict.fromkeys(
            ".".join(name.strip() for name, _ in chain if name) for chain in chains
        )
        raise DataError(
            f"{where}: has several cameras: {', '.join(names)}; expected one, or one of depth"
        )

    def at(width: int, height: int) -> Camera:
        if (width, height) not in modes:
            known = ", ".join(f"{w} x {h}" for w, h in modes)
            raise DataError(f"{width} x {height} pixels; {where} has a camera for {known}")
        return modes[width, height]

    return replace(infos[0], camera=View("own", at, tuple(modes)), lens=infos[0].lens or Lens())


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
    return any(
        (key := _key(name)) == "fx" or (key in ("matrix", "focal") and _numbers(value))
        for name, value in values.items()
    )


def is_known(name: str) -> bool:
    """True for a name that is read in an object with a camera."""
    return _key(name) in {*KNOWN, *ALIASES.values()}


def rank_of(*names: str) -> int:
    """The rank of a camera among others, 0 for depth, by the innermost name that says its kind."""
    for name in reversed(names):
        for rank, kind in enumerate(KINDS):
            if kind.search(name):
                return rank if rank < UNNAMED else COLOUR
    return UNNAMED


def _key(name: str, value: Any = None) -> str:
    """The key of a camera.json, or one of those in ``ALIASES`` alone, for a name; itself if
    it is unknown.

    A value with a width and a height alone is a size under any name.
    """
    if isinstance(value, dict) and {_key(one) for one in value} == {*SIZE}:
        return "size"
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
        self._where, self._is_replaced = where, is_replaced
        self._values, self.fields = dict[str, Any](), dict[str, str]()
        (_, own), *around = reversed(chain)
        is_doubled = any(_key(name) == "fx" for name in own)  # of two forms the matrix is not used
        for name, value in own.items():
            if value is not None and not (is_doubled and _key(name) == "matrix"):
                self._take(name, value)
        self.unused = [name for name in own if name not in self.fields]
        for _, outer in around:  # they may say the size, the lens and what holds for the frames
            size = {"size", *SIZE} if "width" not in self._values else set()
            lens = set(LENS) if self._values.keys().isdisjoint(LENS) else set()
            wanted = (size | lens | {"scale", *FIELDS}) - self._values.keys()
            for name, value in outer.items():
                if _key(name, value) in wanted and value is not None:
                    self._take(name, value)
        more = f"{', '.join(self.unused[:MAX_NAMES])}{' ...' * (len(self.unused) > MAX_NAMES)}"
        self.words = ", ".join(self.fields) + (f"; not used: {more}" if more else "")
        self.is_own = len(chain) < 2 and all(name in KNOWN for name in self.fields)
        self.info = self._info()

    def _refuse(self, what: str) -> NoReturn:
        raise DataError(f"{self._where}: {what}")

    def _take(self, name: str, value: Any) -> None:
        """Take what a value says, if its key is known. Raises DataError."""
        for key, plain in self._plain(name, value).items():
            if key in self._values:
                self._refuse(f"says {key} twice" + (f", once as {name}" if key != name else ""))
            self._values[key] = self._checked(key, plain)
            self.fields[name] = "lens" if key in LENS else key if key in FIELDS else "camera"

    def _plain(self, name: str, value: Any) -> dict[str, Any]:
        """The values of keys of a camera.json that a name and its value mean. Raises DataError."""
        key = _key(name, value)
        if key == "matrix":
            self.fields[name] = "camera"
            try:
                return dict(zip(INTRINSICS, _of_matrix(value, f"{self._where}: {name}")))
            except DataError:
                if self._is_replaced:
                    return {}
                raise
        if key in ROWS:
            inner = (
                {_key(one): number for one, number in value.items()}
                if isinstance(value, dict)
                else {}
            )
            row = [inner.get(one) for one in ROWS[key]] if inner else value
            return dict(zip(ROWS[key], row)) if isinstance(row, list) and len(row) == 2 else {}
        if (
            key in ("distortion", "coefficients")
            and isinstance(value, dict)
            and not _numbers(value)
        ):
            if strange := next((one for one in value if _key(one) not in LENS[1:]), None):
                self._refuse(f"{name}: {unknown_key(strange, LENS[1:])}")
            return {_key(one): number for one, number in value.items()}
        if key == "scale":
            key = "unit_mm"
            if _is_number(value):
                value = (
                    1000 / value
                    if value >= PER_METRE
                    else 1000 * value
                    if value < IN_METRES
                    else value
                )
        if key == "distortion":
            key = "model" if isinstance(value, str) else "coefficients"
        return {key: value} if key in KNOWN else {}

    def _checked(self, key: str, value: Any) -> Any:
        """The value of a key, numbers as such.

        Raises DataError for one of another kind, or out of range.
        """
        expected = "a number that is finite"
        if key == "coefficients":
            value, expected = _numbers(value) or value, "a list of numbers: k1, k2, p1, p2, k3 ..."
            is_good, key = _numbers(value) is not None, "distortion"
        elif key == "time_unit":
            is_good, expected = value in TIME_UNITS, ", ".join(TIME_UNITS)
        elif key in ("name", "model"):
            is_good, expected = isinstance(value, str), "a text"
        elif key in RANGES:
            low, high = RANGES[key]
            is_good = _is_number(value) and low < value <= high
            expected = f"a number more than {low:g} and at most {high:g}"
            if is_good and key in SIZE:
                is_good, expected = value % 1 == 0, "a whole number"
        else:
            is_good = _is_number(value)
        if not is_good:
            self._refuse(f"{key} is {_shown(value)}; expected {expected}")
        return int(value) if key in SIZE else float(value) if _is_number(value) else value

    def _info(self) -> CameraInfo:
        """The parameters. Raises DataError."""
        said = self._values
        camera, unit_mm, rate, time_unit = None, *(said.get(key) for key in FIELDS)
        for keys in INTRINSICS, SIZE:
            missing = [key for key in keys if key not in said]
            if len(missing) in (1, 2, 3) and len(missing) < len(keys):
                there = next(key for key in keys if key in said)
                self._refuse(f"has {there}, but not {' and '.join(missing)}")
        if "fx" in said:
            rest = (
                said.get(key, default)
                for key, default in (*zip(SIZE, (0, 0)), (MIN_RANGE, MIN_RANGE_MM))
            )
            camera = Camera(said.get("name", "own"), *(said[key] for key in INTRINSICS), *rest)
        elif stray := [key for key in (*SIZE, "name", MIN_RANGE) if key in said]:
            self._refuse(f"has {stray[0]}, but not fx, fy, u0, v0")
        lens, by_name = (
            None,
            [said.get(key, 0.0) for key in BROWN if not said.keys().isdisjoint(BROWN)],
        )
        if by_name and "coefficients" in said:
            self._refuse("says the distortion twice, once as k1 ... or p1 ...")
        if by_name or "coefficients" in said or "model" in said:
            lens = lens_of(
                said.get("model", "brown_conrady"), said.get("coefficients", by_name), self._where
            )
        return CameraInfo(camera, lens, unit_mm, rate, self._where, time_unit)


def _of_matrix(value: Any, where: str) -> list[float]:
    """fx, fy, u0, v0 of a matrix by rows or by columns, or of these four numbers.

    Raises DataError.
    """
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
    raise DataError(
        f"{where} is {_shown(value)}; expected [[fx, 0, cx], [0, fy, cy], [0, 0, 1]], or fx, fy, cx, cy"
    )


def _numbers(value: Any) -> list[float] | None:
    """The numbers in lists, or in the data of an object with rows and columns; None for
    anything else.
    """
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
