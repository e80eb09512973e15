"""camera.json: the parameters of a depth camera, next to its frames or within their file.

{"fx": 476.0, "fy": 476.0, "u0": 313.7, "v0": 242.8, "width": 640, "height": 480, "unit_mm": 0.125, "rate": 30,
 "distortion": {"model": "brown_conrady", "coefficients": [0.1, -0.2, 0, 0, 0]}}

fx, fy, u0, v0  px, all four or none; cx, cy and ppx, ppy are other names of u0, v0
width, height   px of the frames, both or none
unit_mm         depth of a stored value of 1 in mm; RealSense's depth_scale is in metres
rate            frames per second; also fps
min_range_mm    nearer readings are errors and count as missing; default 200
distortion      of the lens: as above, or the coefficients alone. RealSense's model and coeffs and Azure's k1 ... p2 may
                also be keys next to fx
name            of the camera
time_unit       of the times in the names of the frames or in their file: s, ms, us, ns, or frames for numbers
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterable
from pathlib import Path
from typing import Any, NoReturn

from handpose.frames.cameras import MIN_RANGE_MM, Camera
from handpose.frames.json_fields import unique_keys
from handpose.frames.lens import Lens, lens_of
from handpose.frames.recording import CameraInfo
from netlib.errors import DataError, did_you_mean
from netlib.files import atomic, read_text
from netlib.files.paths import exists

NAME = "camera.json"
SAME = {  # synonyms of a key, and the factors of their values
    "cx": ("u0", 1), "ppx": ("u0", 1), "cy": ("v0", 1), "ppy": ("v0", 1), "fps": ("rate", 1),
    "depth_scale": ("unit_mm", 1000), "depth_units": ("unit_mm", 1000), "coeffs": ("coefficients", 1),
}
RANGES = {  # exclusive lower and inclusive upper bounds
    "fx": (0, 1e6), "fy": (0, 1e6), "u0": (-1e6, 1e6), "v0": (-1e6, 1e6), "unit_mm": (0, 1e4), "rate": (0, 1e4),
    "width": (0, 1 << 14), "height": (0, 1 << 14), "min_range_mm": (0, 1e4),
}
MIN_RANGE = "min_range_mm"
TIME_UNITS = ("s", "ms", "us", "ns", "frames")
INTRINSICS, SIZE = ("fx", "fy", "u0", "v0"), ("width", "height")
BROWN = ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")  # in OpenCV's order
LENS = ("distortion", "model", "coefficients", *BROWN)
IGNORED = ("codx", "cody", "metric_radius")  # Azure's: 0, 0, and the valid radius of its inverse
KNOWN = (*RANGES, "name", *LENS, *IGNORED, "time_unit")
KEYS = (*KNOWN, *SAME)  # all valid keys


def next_to(source: Path) -> CameraInfo:
    """The camera.json of a recording: in a folder, next to a file as NAME.camera.json or camera.json.

    Raises DataError.
    """
    return next((read(place) for place in places_next_to(source) if exists(place)), CameraInfo())


def places_next_to(source: Path) -> list[Path]:
    """The possible paths of a camera.json, the most specific first."""
    return [source / NAME] if source.is_dir() else [source.with_suffix(f".{NAME}"), source.with_name(NAME)]


def read(path: Path) -> CameraInfo:
    """Read a camera.json. Raises DataError."""
    return parse(read_text(path, "the camera"), str(path))


def write(path: Path, given: CameraInfo) -> None:
    """Write a camera.json atomically. Raises OSError."""
    atomic.replace_text(path, to_text(given) + "\n")


def to_text(given: CameraInfo) -> str:
    """The text that ``parse`` reads, without loss of precision."""
    said: dict[str, Any] = {}
    if given.camera is not None:
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
    """Parse the text of a camera.json; ``where`` begins every error. Raises DataError."""
    return of(_loaded(text, where), where)


def of(values: dict[str, Any], where: str) -> CameraInfo:
    """The camera parameters of a camera.json's values. Raises DataError."""
    said = _Said(values, where)
    said.check(KNOWN)
    camera = None
    if said.all_or_none(INTRINSICS):
        fx, fy, u0, v0 = (said.number(key) for key in INTRINSICS)
        sized = said.all_or_none(SIZE)
        width, height = (said.whole(key) if sized else 0 for key in SIZE)
        min_range = said.number(MIN_RANGE) if MIN_RANGE in said.values else MIN_RANGE_MM
        camera = Camera(said.text("name", "own"), fx, fy, u0, v0, width, height, min_range)
    elif stray := [key for key in (*SIZE, "name", MIN_RANGE) if key in said.values]:
        said.refuse(f"has {stray[0]}, but not fx, fy, u0, v0")
    unit, rate = (said.number(key) if key in said.values else None for key in ("unit_mm", "rate"))
    return CameraInfo(camera, _lens(said), unit, rate, where, said.time_unit())


def _lens(said: _Said) -> Lens | None:
    """The lens of an object with any of its keys."""
    for key in IGNORED:
        if key in said.values and said.number(key) and key != "metric_radius":
            said.refuse(f"has {key} {said.number(key):g}; expected 0, a distortion about the middle of the lens")
    ways = [way for way in (("distortion",), ("coefficients",), BROWN) if any(key in said.values for key in way)]
    if len(ways) > 1:
        said.refuse(f"says the distortion twice: {ways[0][0]} and {ways[1][0]}")
    inner = said.values.get("distortion")
    if isinstance(inner, dict):
        if "model" in said.values:
            said.refuse("says the model of the distortion, and a distortion that has its own")
        nested = _Said(inner, f"{said.where}: distortion")
        nested.check(("model", "coefficients", *BROWN, *IGNORED))
        return _lens(nested)
    model = said.text("model", "brown_conrady")
    if not ways:
        return lens_of(model, (), said.where) if "model" in said.values else None
    if ways[0] is BROWN:
        values = [said.number(key) if key in said.values else 0.0 for key in BROWN]
    else:
        values = said.numbers(ways[0][0])
    return lens_of(model, values, said.where)


class _Said:
    """The values of a JSON object by the main name of their keys; ``where`` begins errors."""

    def __init__(self, pairs: dict[str, Any], where: str) -> None:
        self.where = where
        self.values: dict[str, Any] = {}
        for key, value in pairs.items():
            own, factor = SAME.get(key, (key, 1))
            if own in self.values:
                self.refuse(f"says {own} twice" + (f", once as {key}" if key != own else ""))
            self.values[own] = value * factor if factor != 1 and _is_number(value) else value

    def refuse(self, what: str) -> NoReturn:
        raise DataError(f"{self.where}: {what}")

    def check(self, known: Iterable[str]) -> None:
        """Check that all keys are known."""
        for key in self.values:
            if key not in known:
                self.refuse(f"unknown key {key!r}{did_you_mean(key, (*known, *SAME))}; known: {', '.join(known)}")

    def all_or_none(self, keys: tuple[str, ...]) -> bool:
        """True if all of the keys are present, False if none is; raises DataError otherwise."""
        missing = [key for key in keys if key not in self.values]
        if missing and len(missing) < len(keys):
            there = next(key for key in keys if key in self.values)
            self.refuse(f"has {there}, but not {' and '.join(missing)}")
        return not missing

    def number(self, key: str) -> float:
        value = self.values[key]
        low, high = RANGES.get(key, (-math.inf, math.inf))
        if not _is_number(value) or not low < value <= high:
            expected = f"more than {low:g} and at most {high:g}" if key in RANGES else "that is finite"
            self.refuse(f"{key} is {_shown(value)}; expected a number {expected}")
        return float(value)

    def whole(self, key: str) -> int:
        if self.number(key) % 1:
            self.refuse(f"{key} is {self.values[key]}; expected a whole number")
        return int(self.values[key])

    def numbers(self, key: str) -> list[float]:
        value = self.values[key]
        if not isinstance(value, list) or not all(map(_is_number, value)):
            self.refuse(f"{key} is {_shown(value)}; expected a list of numbers: k1, k2, p1, p2, k3 ...")
        return [float(one) for one in value]

    def text(self, key: str, default: str) -> str:
        value = self.values.get(key, default)
        if not isinstance(value, str):
            self.refuse(f"{key} is {_shown(value)}; expected a text")
        return value

    def time_unit(self) -> str | None:
        value = self.values.get("time_unit")
        if value not in (None, *TIME_UNITS):
            self.refuse(f"time_unit is {_shown(value)}; expected {', '.join(TIME_UNITS)}")
        return value


def _is_number(value: object) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool) and abs(value) < 1e300


def _shown(value: object) -> str:
    text = json.dumps(value)
    return text if len(text) <= 40 else f"{text[:40]} ..."


def _loaded(text: str, where: str) -> dict[str, Any]:
    """A JSON object without repeated keys."""

    def no_number(word: str) -> NoReturn:
        raise DataError(f"{where}: found {word}; expected finite numbers")

    try:
        found = json.loads(text, object_pairs_hook=unique_keys(where), parse_constant=no_number)
    except json.JSONDecodeError as error:
        raise DataError(f"{where}:{error.lineno}:{error.colno}: not JSON: {error.msg}") from None
    except (ValueError, RecursionError):  # numbers of thousands of digits, thousands of brackets
        raise DataError(f"{where}: not the JSON of a camera") from None
    if not isinstance(found, dict):
        raise DataError(f'{where}: found {_shown(found)}; expected {{"fx": ..., "fy": ..., "u0": ..., "v0": ...}}')
    return found
