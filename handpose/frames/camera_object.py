"""Read the camera in one object of a document, with what the objects around it give for it."""

from __future__ import annotations

import json
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from typing import Any, NoReturn

import numpy as np

from handpose.frames.camera_keys import (
    ALIASES,
    AXES,
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
    UNITS_MM,
    is_known,
    is_number,
    key_of,
    numbers_in,
    unknown_key,
)
from handpose.frames.camera_text import value_of
from handpose.frames.cameras import Camera
from handpose.frames.lens import Lens, lens_of
from handpose.frames.recording import CameraInfo
from handpose.frames.time_units import TIME_UNITS
from netlib.errors import DataError, some_of

Chain = list[tuple[str, dict[str, Any]]]  # names and objects, from the document to one within it

# Groups of keys: an object around a camera gives those of which the inner objects have none.
AROUND = (("size", *SIZE), LENS, ("depthscale", "unit_mm"), ("rate",), ("time_unit",))
IN_LENS = ("model", "coefficients", *BROWN)  # the keys of an object of a distortion
MATRIX = "[[fx, 0, cx], [0, fy, cy], [0, 0, 1]], or fx, fy, cx, cy"
MATRIX_SHAPES = {9: (3, 3), 12: (3, 4), 16: (4, 4)}  # of matrices, by the number of their elements
PLACES = ([0, 1, 0, 1], [0, 1, 2, 2])  # of fx, fy, u0, v0 in a matrix
MAX_SHOWN_CHARACTERS = 40  # characters of a value in a message


@dataclass(frozen=True)
class FoundCamera:
    """A camera in an object of a document.

    info    the parameters
    name    of the object
    fields  for each used key the field of CameraInfo that it gives
    unused  the other keys of the same object, but for known ones whose value is null: unknown
    is_own  whether all used keys are those of a camera.json
    """

    info: CameraInfo
    name: str
    fields: dict[str, str]
    unused: list[str]
    is_own: bool

    @property
    def words(self) -> str:
        """The used and the unused keys, for people."""
        used = ", ".join(self.fields)
        if not self.unused:
            return used
        return f"{used}; not used: {some_of(self.unused)}"


def read_camera(chain: Chain, where: str, is_replaced: bool) -> FoundCamera:
    """The camera in the last object of a chain; ``where`` and ``is_replaced`` as for ``find``.

    Raises DataError.
    """
    own = chain[-1][1]
    parameters = _Parameters(where, is_replaced)
    parameters.add(own, _own_keys(own))
    for _, around in reversed(chain[:-1]):
        parameters.add(around, parameters.open_keys())
    fields = parameters.fields
    given = [name for name, value in own.items() if value is not None or not is_known(name)]
    unused = [name for name in given if name not in fields]
    names = ".".join(name.strip() for name, _ in chain if name)
    is_own = len(chain) == 1 and fields.keys() <= {*KNOWN}
    return FoundCamera(parameters.info(), names, fields, unused, is_own)


def _own_keys(own: Mapping[str, Any]) -> set[str]:
    """The keys that are read in the object of a camera: all, but no matrix next to fx."""
    has_fx = any(key_of(name) == "fx" for name, value in own.items() if value is not None)
    return {*ALIASES.values()} - ({"matrix"} if has_fx else set())


class _Parameters:
    """The parameters of one camera, collected from an object and those around it.

    values  by the keys of a camera.json
    fields  for each name that was used the field of CameraInfo that it gives
    """

    def __init__(self, where: str, is_replaced: bool) -> None:
        self.values: dict[str, Any] = {}
        self.fields: dict[str, str] = {}
        self._where = where
        self._is_replaced = is_replaced

    # ---------------------------------------------------------------------------------- collecting

    def add(self, values: Mapping[str, Any], wanted: Collection[str]) -> None:
        """Add what an object has under the wanted keys. Raises DataError."""
        for name, value in values.items():
            if value is not None and key_of(name, value) in wanted:
                self._add(name, value)

    def open_keys(self) -> set[str]:
        """The keys that the next object around the camera may give."""
        open_groups = [group for group in AROUND if self.values.keys().isdisjoint(group)]
        return {key for group in open_groups for key in group}

    def _add(self, name: str, value: Any) -> None:
        for key, plain in self._plain(name, value).items():
            if key in self.values:
                self._refuse_second(key, name)
            self.values[key] = self._checked(key, plain)
            self.fields[name] = _field_of(key)

    def _plain(self, name: str, value: Any) -> dict[str, Any]:
        """What a name and its value mean, by the keys of a camera.json. Raises DataError."""
        key = key_of(name, value)
        if key == "matrix":
            return self._in_matrix(name, value)
        if key == "distortion":
            return self._in_distortion(name, value)
        if key == "depthscale":
            return {"unit_mm": _unit_of(value)}
        if key in ROWS:
            return self._in_row(key, value)
        return {key: value}

    def _in_matrix(self, name: str, value: Any) -> dict[str, Any]:
        self.fields[name] = "camera"
        four = _of_matrix(numbers_in(value) or [])
        if not four and not self._is_replaced:
            self._refuse(f"{name} is {shown(value)}; expected {MATRIX}")
        return dict(zip(INTRINSICS, four))

    def _in_distortion(self, name: str, value: Any) -> dict[str, Any]:
        if isinstance(value, str):
            return {"model": value}
        if not isinstance(value, dict) or numbers_in(value):
            return {"distortion": value}
        inner = self._by_keys(value)
        for key in inner:
            if key not in LENS:
                self._refuse(f"{name}: {unknown_key(key, IN_LENS)}")
        return inner

    def _in_row(self, key: str, value: Any) -> dict[str, Any]:
        """Two values in a row, in an object, or in a text such as 640x480; empty for others."""
        keys = ROWS[key]
        row = value
        if isinstance(value, dict):
            inner = self._by_keys(value)
            row = [inner.get(key, inner.get(axis)) for key, axis in zip(keys, AXES)]
        elif key == "size" and isinstance(value, str):
            row = value_of(value)
        is_row = isinstance(row, list) and len(row) == len(keys)
        return dict(zip(keys, row)) if is_row else {}

    def _by_keys(self, values: Mapping[str, Any]) -> dict[str, Any]:
        """An object by the keys of a camera.json, without known ones whose value is null.

        Raises DataError if two names mean the same key.
        """
        found: dict[str, Any] = {}
        for name, value in values.items():
            key = key_of(name)
            if value is None and is_known(name):
                continue
            if key in found:
                self._refuse_second(key, name)
            found[key] = value
        return found

    # ------------------------------------------------------------------------------------ checking

    def _checked(self, key: str, value: Any) -> Any:
        """The value of a key in its type.

        Raises DataError for one of another kind, or out of range.
        """
        if key in RANGES:
            return self._checked_number(key, value)
        if key == "distortion":
            numbers = numbers_in(value)
            if numbers is None:
                self._refuse_value(key, value, "a list of numbers: k1, k2, p1, p2, k3 ...")
            return numbers
        is_text = isinstance(value, str)
        if key == "time_unit" and not (is_text and value in TIME_UNITS):
            self._refuse_value(key, value, ", ".join(TIME_UNITS))
        if not is_text:
            self._refuse_value(key, value, "a text")
        return value

    def _checked_number(self, key: str, value: Any) -> float:
        """A number within its range; width and height as integers. Raises DataError."""
        low, high = RANGES[key]
        if not is_number(value) or not low < value <= high:
            self._refuse_value(key, value, f"a number more than {low:g} and at most {high:g}")
        number = float(value)
        if key not in SIZE:
            return number
        if not number.is_integer():
            self._refuse_value(key, value, "a whole number")
        return int(number)

    def _refuse_value(self, key: str, value: Any, expected: str) -> NoReturn:
        self._refuse(f"{key} is {shown(value)}; expected {expected}")

    def _refuse_second(self, key: str, name: str) -> NoReturn:
        self._refuse(f"says {key} twice, once as {name}")

    def _refuse(self, what: str) -> NoReturn:
        raise DataError(f"{self._where}: {what}")

    # ---------------------------------------------------------------------------------- the camera

    def info(self) -> CameraInfo:
        """The parameters. Raises DataError if some are missing."""
        fields: dict[str, Any] = {key: self.values.get(key) for key in FIELDS}
        return CameraInfo(self._camera(), self._lens(), origin=self._where, **fields)

    def _camera(self) -> Camera | None:
        """The camera; None without one of its keys. Raises DataError if others are missing."""
        given = {key: self.values[key] for key in CAMERA if key in self.values}
        if not given:
            return None
        first = next(iter(given))
        needed = (*SIZE, *INTRINSICS) if first in SIZE else INTRINSICS
        missing = [key for key in needed if key not in given]
        if missing:
            separator = " and " if len(missing) < len(INTRINSICS) else ", "
            self._refuse(f"has {first}, but not {separator.join(missing)}")
        return Camera(**DEFAULTS | given)

    def _lens(self) -> Lens | None:
        """The lens; None without one of its keys. Raises DataError."""
        values = self.values
        coefficients = values.get("distortion")
        if values.keys() & BROWN:
            if coefficients is not None:
                self._refuse("says the distortion twice, once as k1 ... or p1 ...")
            coefficients = [values.get(key, 0.0) for key in BROWN]
        if coefficients is None and "model" not in values:
            return None
        model = values.get("model", "brown_conrady")
        return lens_of(model, coefficients or [], self._where)


def _field_of(key: str) -> str:
    """The field of CameraInfo that a key gives."""
    if key in LENS:
        return "lens"
    return key if key in FIELDS else "camera"


def _unit_of(scale: Any) -> Any:
    """The unit in mm of a depth scale, or of the name of a unit; the scale itself if it is none."""
    if isinstance(scale, str):
        return UNITS_MM.get(scale.lower(), scale)
    if not is_number(scale) or scale <= 0:
        return scale
    if scale < IN_METRES:
        return 1000 * scale
    return 1000 / scale if scale >= PER_METRE else scale


def _of_matrix(numbers: list[float]) -> list[float]:
    """fx, fy, u0, v0 of a matrix by rows or by columns, or of these four; none of others."""
    if len(numbers) == len(INTRINSICS):
        return numbers
    if len(numbers) not in MATRIX_SHAPES:
        return []
    shape = MATRIX_SHAPES[len(numbers)]
    identity = np.eye(*shape)
    for order in ("C", "F"):
        matrix = np.reshape(numbers, shape, order)
        expected = identity.copy()
        expected[PLACES] = matrix[PLACES]
        is_pose = np.array_equal(matrix, identity)  # of a camera at the origin
        if np.array_equal(matrix, expected) and not is_pose:
            return [float(number) for number in matrix[PLACES]]
    return []


def shown(value: object) -> str:
    """The JSON of a value, or its beginning, for a message."""
    text = json.dumps(value)
    return text if len(text) <= MAX_SHOWN_CHARACTERS else f"{text[:MAX_SHOWN_CHARACTERS]} ..."
