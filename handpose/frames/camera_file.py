"""camera.json: the parameters of a depth camera, next to its frames or within their file; other files with a camera.

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

Files of other programs are read by ``camera_values`` from whatever ``documents`` can load.
"""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

from handpose.frames import camera_values, documents
from handpose.frames.camera_values import INTRINSICS, MIN_RANGE, SIZE
from handpose.frames.cameras import MIN_RANGE_MM, Camera
from handpose.frames.recording import CameraInfo
from netlib.errors import DataError
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
    return _of(documents.load(path), str(path))


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
    return _of(documents.parse(text, where), where)


def _of(document: Any, where: str) -> CameraInfo:
    try:
        found = camera_values.find(document, where)
    except RecursionError:  # thousands of brackets
        raise DataError(f"{where}: not the parameters of a camera") from None
    if found.unused and (found.is_own or found.info.camera is None):
        raise DataError(f"{where}: {camera_values.unknown_key(found.unused[0])}")
    return found.info if found.is_own else replace(found.info, origin=f"{where} ({found.words})")
