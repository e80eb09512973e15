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

Files of other programs are read, too: JSON, YAML, OpenCV's XML, NumPy's arrays, and tables of numbers, in which
``camera_values`` finds the camera. YAML is the part of it in which programs write parameters.
"""

from __future__ import annotations

import io
import json
import re
import zipfile
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any, NoReturn
from xml.etree import ElementTree

import numpy as np

from handpose.frames import camera_values
from handpose.frames.camera_values import INTRINSICS, MIN_RANGE, SIZE
from handpose.frames.cameras import MIN_RANGE_MM, Camera
from handpose.frames.json_fields import unique_keys
from handpose.frames.recording import CameraInfo
from netlib import files
from netlib.errors import DataError, reason_of
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
    return _of(load(path), str(path))


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
    return _of(parse_document(text, where), where)


def _of(document: Any, where: str) -> CameraInfo:
    try:
        found = camera_values.find(document, where)
    except RecursionError:  # thousands of brackets
        raise DataError(f"{where}: not the parameters of a camera") from None
    if found.unused and (found.is_own or found.info.camera is None):
        raise DataError(f"{where}: {camera_values.unknown_key(found.unused[0])}")
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


def load(path: Path) -> Any:
    """The content of a file, by its first bytes. Raises DataError."""
    content = files.read_bytes(path, "the camera", limit=MAX_BYTES)
    if content.startswith((b"\x93NUMPY", b"PK")):
        return _arrays(content, str(path))
    try:
        return parse_document(content.decode("utf-8-sig"), str(path))
    except UnicodeDecodeError:
        raise DataError(f"{path}: neither text nor NumPy's; expected the parameters of a camera") from None


def parse_document(text: str, where: str) -> Any:
    """The value of a text: of a table the list of its numbers. ``where`` begins errors. Raises DataError."""
    start = text.lstrip()[:1]
    try:
        if not NOT_OF_A_TABLE.search(text) and (numbers := NUMBER.findall(text)):
            return [float(number) for number in numbers]
        if start == "<":
            return _of_xml(text, where)
        if start in ("", "{", "["):
            return _of_json(text, where)
        return _of_lines(text, where)
    except (ValueError, RecursionError):  # numbers of thousands of digits, thousands of brackets
        raise DataError(f"{where}: not the parameters of a camera") from None


def _arrays(content: bytes, where: str) -> Any:
    """The array of an .npy file, or a dictionary of those of an .npz file, as lists."""
    try:
        if content.startswith(b"PK"):
            with zipfile.ZipFile(io.BytesIO(content)) as archive:
                if sum(entry.file_size for entry in archive.infolist()) > MAX_BYTES:
                    raise ValueError("its arrays are too large")
        found = np.load(io.BytesIO(content), allow_pickle=False)
        return found.tolist() if isinstance(found, np.ndarray) else {name: found[name].tolist() for name in found.files}
    except Exception as error:  # NumPy and the decoders may raise anything for a damaged file
        raise DataError(f"{where}: not the arrays of a camera: {reason_of(error)[:200]}") from None


def _of_json(text: str, where: str) -> Any:
    def no_number(word: str) -> NoReturn:
        raise DataError(f"{where}: found {word}; expected finite numbers")

    try:
        return json.loads(text, object_pairs_hook=unique_keys(where), parse_constant=no_number)
    except json.JSONDecodeError as error:
        raise DataError(f"{where}:{error.lineno}:{error.colno}: not JSON: {error.msg}") from None


def _of_xml(text: str, where: str) -> Any:
    if "<!" in re.sub(r"<!--.*?-->", "", text, flags=re.DOTALL):
        raise DataError(f"{where}: XML with declarations; expected that of OpenCV's FileStorage")

    def value(element: ElementTree.Element) -> Any:
        if len(element):
            return unique_keys(where)([(child.tag, value(child)) for child in element])
        return _scalar(element.text or "")

    try:
        return value(ElementTree.fromstring(text))
    except ElementTree.ParseError as error:
        raise DataError(f"{where}: not XML: {error}") from None


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
