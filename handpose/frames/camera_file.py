"""camera.json, the parameters of a depth camera next to its frames or within their file, and other
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
time_unit       of the times in the names of the frames or in their file: s, ms, us,
                100ns, ns, or frames for numbers

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
import re
from dataclasses import replace
from pathlib import Path

from handpose.frames.camera_keys import CAMERA, DEFAULTS, FIELDS, NOT_READ, unknown_key
from handpose.frames.camera_search import find
from handpose.frames.camera_text import parse_document
from handpose.frames.cameras import Camera
from handpose.frames.recording import CameraInfo
from netlib import files
from netlib.errors import DataError, reason_of
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
    """Write a camera.json atomically.

    Raises DataError for a camera that ``read`` would not accept, OSError.
    """
    text = to_text(given)
    parse(text, str(path))
    atomic.replace_text(path, text + "\n")


def to_text(given: CameraInfo) -> str:
    """The text that ``parse`` reads, without loss of precision."""
    known = vars(given.camera) if isinstance(given.camera, Camera) else {}
    known = known | vars(given)
    keys = [key for key in (*CAMERA, *FIELDS) if known.get(key) not in (None, DEFAULTS.get(key))]
    written = {key: known[key] for key in keys}
    if given.lens is not None and not given.lens.is_straight:
        written["distortion"] = vars(given.lens)
    return json.dumps(written, indent=1, default=float)


def parse(text: str, where: str) -> CameraInfo:
    """Parse the text of a camera.json or of another file; ``where`` begins every error.

    Raises DataError.
    """
    try:
        found = find(parse_document(text, where), where)
    except RecursionError:  # thousands of brackets
        raise DataError(f"{where}: not the parameters of a camera") from None
    must_know_all = found.is_own or found.info.camera is None
    if found.unused and must_know_all:
        for pattern, what in NOT_READ.items():
            if re.search(pattern, text):
                raise DataError(f"{where}: {what}")
        raise DataError(
            f"{where}: {unknown_key(found.unused[0])}; or give the numbers: --camera FX,FY,U0,V0"
        )
    if found.is_own:
        return found.info
    return replace(found.info, origin=f"{where} ({found.words})")
