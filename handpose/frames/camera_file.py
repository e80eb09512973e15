"""camera.json: the parameters of a depth camera, next to its frames or within their file; other
files with a camera.

{"fx": 476.0, "fy": 476.0, "u0": 313.7, "v0": 242.8, "width": 640, "height": 480,
 "unit_mm": 0.125, "rate": 30,
 "distortion": {"model": "brown_conrady", "coefficients": [0.1, -0.2, 0, 0, 0]}}

fx, fy, u0, v0  px, all four or none; cx, cy and ppx, ppy are other names of u0, v0
width, height   px of the frames, both or none
unit_mm         depth of a stored value of 1 in mm; RealSense's depth_scale is in metres
rate            frames per second; also fps
min_range_mm    nearer readings are errors and count as missing; default 200, 0 for none
distortion      of the lens: as above, or the coefficients alone; model, coeffs, k1 ... p2 may also
                be keys next to fx
name            of the camera
time_unit       of the times in the names of the frames or in their file: s, ms, us, ns, or
                frames for numbers

Files of other programs are read by the same keys under the names in ``camera_keys``, whatever their
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

import json
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NoReturn

import numpy as np

from handpose.frames.camera_keys import (
    ALIASES,
    BROWN,
    CAMERA,
    DEFAULTS,
    FIELDS,
    IN_METRES,
    INTRINSICS,
    KNOWN,
    LENS,
    PER_METRE,
    RANGES,
    ROWS,
    SIZE,
    has_camera,
    is_known,
    is_number,
    key_of,
    numbers_in,
    rank_of,
    unknown_key,
)
from handpose.frames.camera_text import parse_document, value_of
from handpose.frames.cameras import Camera, View
from handpose.frames.lens import Lens, lens_of
from handpose.frames.recording import CameraInfo
from handpose.frames.time_units import TIME_UNITS
from netlib import files
from netlib.errors import DataError, reason_of, some_of
from netlib.files import atomic

NAME = "camera.json"
WIDE_BOMS = (b"\xff\xfe", b"\xfe\xff")
MAX_BYTES = 1 << 22  # of a file; calibrations have some 10,000
MAX_SHOWN_CHARACTERS = 40  # characters of a value in a message


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
        raise DataError(
            f"{where}: {unknown_key(found.unused[0])}; or give the numbers: --camera FX,FY,U0,V0"
        )
    return found.info if found.is_own else replace(found.info, origin=f"{where} ({found.words})")


# ------------------------------------------------------------------------------ among other objects


_Chain = list[tuple[str, dict[str, Any]]]  # names and objects, from the document to one within it


def find(document: Any, where: str, is_replaced: bool = False) -> FoundCamera:
    """The camera in a document of plain values; ``where`` begins errors.

    is_replaced  whether the user gives the camera, so that the document's matrix need not be valid

    Raises DataError.
    """
    if not isinstance(document, dict):
        document = _of_numbers(document, where)
    chains = [chain for chain in _objects(document, []) if has_camera(chain[-1][1])]
    chains = chains or [[("", document)]]
    ranks = [_rank(chain) for chain in chains]
    best = min(ranks)
    chosen = [chain for chain, rank in zip(chains, ranks) if rank == best]
    found = [FoundCamera(chain, where, is_replaced) for chain in chosen]
    if len({one.info for one in found}) > 1:
        found[0].info = _of_modes(found, where)
    return found[0]


def _of_numbers(document: Any, where: str) -> dict[str, Any]:
    """The object of a matrix, or of fx, fy, cx, cy, which width and height may follow."""
    numbers = numbers_in(document)
    if not numbers:
        form = '{"fx": ..., "fy": ..., "u0": ..., "v0": ...}'
        raise DataError(f"{where}: found {_shown(document)}; expected {form}")
    if len(numbers) == len(INTRINSICS) + len(SIZE):
        return {"matrix": numbers[:4], "size": numbers[4:]}
    return {"matrix": document}


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


def _rank(chain: _Chain) -> int:
    """The rank of a camera, by the names around it and the texts in it."""
    return rank_of(*(name for name, _ in chain), *map(str, chain[-1][1].values()))


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


# ------------------------------------------------------------------------------------ in one object

# what the objects around a camera say for it, unless it says one of the same group
AROUND = (("size", *SIZE), LENS, ("depthscale", "unit_mm"), ("rate",), ("time_unit",))
IN_LENS = ("model", "coefficients", *BROWN)  # the keys of an object of a distortion
MATRIX = "[[fx, 0, cx], [0, fy, cy], [0, 0, 1]], or fx, fy, cx, cy"
MATRIX_SHAPES = {9: (3, 3), 12: (3, 4), 16: (4, 4)}  # of matrices, by the number of their elements
PLACES = ([0, 1, 0, 1], [0, 1, 2, 2])  # of fx, fy, u0, v0 in a matrix


class FoundCamera:
    """The camera in the last object of a chain, with what those around it say. Raises DataError.

    info    the parameters
    name    of the object
    fields  for each used key the field of CameraInfo that it gives
    unused  the other keys of the same object, but for known ones whose value is null: unknown
    words   both, for people
    is_own  whether all used keys are those of a camera.json
    """

    def __init__(self, chain: _Chain, where: str, is_replaced: bool) -> None:
        self._where = where
        self._is_replaced = is_replaced
        self._values: dict[str, Any] = {}
        self.fields: dict[str, str] = {}
        own = chain[-1][1]
        wanted = {*ALIASES.values()}
        # of two forms the matrix is not used
        if any(key_of(name) == "fx" and value is not None for name, value in own.items()):
            wanted -= {"matrix"}
        for _, values in reversed(chain):
            for name, value in values.items():
                if value is not None and key_of(name, value) in wanted:
                    self._take(name, value)
            found = self._values.keys()
            wanted = {key for group in AROUND if found.isdisjoint(group) for key in group}
        self.name = ".".join(name.strip() for name, _ in chain if name)
        said = [name for name, value in own.items() if value is not None or not is_known(name)]
        self.unused = [name for name in said if name not in self.fields]
        self.is_own = len(chain) < 2 and self.fields.keys() <= {*KNOWN}
        self.info = self._info()

    @property
    def words(self) -> str:
        """The used and the unused keys."""
        used = ", ".join(self.fields)
        if not self.unused:
            return used
        return f"{used}; not used: {some_of(self.unused)}"

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
        key = key_of(name, value)
        inner = {}
        if isinstance(value, dict):
            inner = {key_of(one): number for one, number in value.items()}
        if key == "matrix":
            self.fields[name] = "camera"
            four = _of_matrix(numbers_in(value) or [])
            if not four and not self._is_replaced:
                self._refuse(f"{name} is {_shown(value)}; expected {MATRIX}")
            return dict(zip(INTRINSICS, four))
        if key in ROWS:
            row = [inner.get(one) for one in ROWS[key]] if inner else value
            if key == "size" and isinstance(value, str):
                row = value_of(value)
            is_row = isinstance(row, list) and len(row) == len(ROWS[key])
            return dict(zip(ROWS[key], row)) if is_row else {}
        if key == "distortion" and isinstance(value, str):
            return {"model": value}
        if key == "distortion" and isinstance(value, dict) and not numbers_in(value):
            for one in inner:
                if one not in LENS:
                    self._refuse(f"{name}: {unknown_key(one, IN_LENS)}")
            return inner
        if key == "depthscale":
            return {"unit_mm": _unit_of(value)}
        return {key: value}

    def _checked(self, key: str, value: Any) -> Any:
        """The value of a key, numbers as such.

        Raises DataError for one of another kind, or out of range.
        """
        plain: Any = value if isinstance(value, str) else None
        expected = "a text"
        if key == "distortion":
            plain = numbers_in(value)
            expected = "a list of numbers: k1, k2, p1, p2, k3 ..."
        elif key == "time_unit":
            plain = plain if plain in TIME_UNITS else None
            expected = ", ".join(TIME_UNITS)
        elif key in RANGES:
            low, high = RANGES[key]
            plain = float(value) if is_number(value) and low < value <= high else None
            expected = f"a number more than {low:g} and at most {high:g}"
            if plain and key in SIZE:
                plain = int(plain) if plain.is_integer() else None
                expected = "a whole number"
        if plain is None:
            self._refuse(f"{key} is {_shown(value)}; expected {expected}")
        return plain

    def _info(self) -> CameraInfo:
        """The parameters. Raises DataError."""
        fields: dict[str, Any] = {key: self._values.get(key) for key in FIELDS}
        return CameraInfo(self._camera(), self._lens(), origin=self._where, **fields)

    def _camera(self) -> Camera | None:
        """The camera; None without one of its keys. Raises DataError if others are missing."""
        said = {key: self._values[key] for key in CAMERA if key in self._values}
        if not said:
            return None
        first = next(iter(said))
        needed = (*SIZE, *INTRINSICS) if first in SIZE else INTRINSICS
        missing = [key for key in needed if key not in said]
        if missing:
            names = (" and " if len(missing) < len(INTRINSICS) else ", ").join(missing)
            self._refuse(f"has {first}, but not {names}")
        return Camera(**DEFAULTS | said)

    def _lens(self) -> Lens | None:
        """The lens; None without one of its keys. Raises DataError."""
        said = self._values
        coefficients = said.get("distortion")
        if said.keys() & BROWN:
            if coefficients is not None:
                self._refuse("says the distortion twice, once as k1 ... or p1 ...")
            coefficients = [said.get(key, 0.0) for key in BROWN]
        if coefficients is None and "model" not in said:
            return None
        return lens_of(said.get("model", "brown_conrady"), coefficients or [], self._where)


def _unit_of(scale: Any) -> Any:
    """The unit in mm of a depth scale."""
    if not is_number(scale) or IN_METRES <= scale < PER_METRE:
        return scale
    return 1000 * scale if scale < IN_METRES else 1000 / scale


def _of_matrix(numbers: list[float]) -> list[float]:
    """fx, fy, u0, v0 of a matrix by rows or by columns, or of these four; none of others."""
    if len(numbers) == len(INTRINSICS):
        return numbers
    for order in ("C", "F") if len(numbers) in MATRIX_SHAPES else ():
        matrix = np.reshape(numbers, MATRIX_SHAPES[len(numbers)], order)
        expected = np.eye(*matrix.shape)
        expected[PLACES] = matrix[PLACES]
        is_pose = np.array_equal(matrix, np.eye(*matrix.shape))  # of a camera at the origin
        if np.array_equal(matrix, expected) and not is_pose:
            return [float(number) for number in matrix[PLACES]]
    return []


def _shown(value: object) -> str:
    text = json.dumps(value)
    return text if len(text) <= MAX_SHOWN_CHARACTERS else f"{text[:MAX_SHOWN_CHARACTERS]} ..."
