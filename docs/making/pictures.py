"""Pictures that a command draws in seconds from what is packaged.

A picture that a fit drew is compared by what it shows: its size and the numbers that the command wrote, which the
picture's file keeps in a text chunk. Others are compared by their pixels.
"""

from __future__ import annotations

import functools
import json
import struct
import subprocess
import sys
import tempfile
import zlib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from docs.making.made import Made
from netlib.files.paths import ROOT

CLOSE = 1.0  # grey levels, on average
CLOSE_TO = {"confidence": 0.05, "angles_rad": np.inf, "translations_mm": np.inf, "bones_mm": 3.0, "center_uvd": 2.0}
CLOSE_MM = 3.0  # of joints, centres and errors
_SIGNATURE, _KEY = b"\x89PNG\r\n\x1a\n", b"Description\0"


def made() -> Iterator[Made]:
    """All of them."""
    for name, (commands, written, same) in PICTURES.items():
        yield Made(ROOT / "docs" / "images" / name, functools.partial(_drawn, commands, written), same)


def alike(there: bytes, wanted: bytes) -> bool:
    """Whether two pictures have the same size and nearly the same pixels."""
    a, b = _image(there), _image(wanted)
    return a is not None and b is not None and a.shape == b.shape and float(np.abs(a - b).mean()) <= CLOSE


def shows_the_same_hands(there: bytes, wanted: bytes) -> bool:
    """Whether two pictures have the same size, and as many hands of the same sides at nearly the same places."""
    a, b = _image(there), _image(wanted)
    numbers = described(there)
    if a is None or b is None or numbers is None:
        return False
    return a.shape == b.shape and _near(numbers, described(wanted), "")


def with_description(png: bytes, words: str) -> bytes:
    """The PNG file with a text chunk in ASCII before its end."""
    data = b"tEXt" + _KEY + words.encode("ascii")
    end = png.rindex(b"IEND") - 4
    return png[:end] + struct.pack(">I", len(data) - 4) + data + struct.pack(">I", zlib.crc32(data)) + png[end:]


def described(png: bytes) -> Any:
    """The JSON value in a PNG file's description; None without one."""
    at = len(_SIGNATURE)
    while at + 8 <= len(png):
        (size,) = struct.unpack_from(">I", png, at)
        if png[at + 4 : at + 8] == b"tEXt" and png.startswith(_KEY, at + 8):
            return json.loads(png[at + 8 + len(_KEY) : at + 8 + size])
        at += size + 12
    return None


def _image(png: bytes) -> NDArray[np.float64] | None:
    found = cv2.imdecode(np.frombuffer(png, np.uint8), cv2.IMREAD_UNCHANGED) if png else None
    return None if found is None else np.asarray(found, np.float64)


def _near(a: Any, b: Any, key: str) -> bool:
    """Whether two JSON values are the same, numbers up to what the key allows."""
    if isinstance(a, dict) and isinstance(b, dict):
        return a.keys() == b.keys() and all(_near(a[k], b[k], k if k in CLOSE_TO else key) for k in a)
    if isinstance(a, list) and isinstance(b, list):
        return len(a) == len(b) and all(_near(x, y, key) for x, y in zip(a, b))
    if isinstance(a, int | float) and isinstance(b, int | float):
        return abs(a - b) <= CLOSE_TO.get(key, CLOSE_MM)
    return bool(a == b)


def _drawn(commands: tuple[str, ...], written: str) -> bytes:
    """The picture that the commands write; numbers that they write next to it are stored in its description."""
    with tempfile.TemporaryDirectory() as folder:
        for command in commands:
            tool, *options = command.split()
            subprocess.run([sys.executable, str(ROOT / tool), *options], cwd=folder, check=True, capture_output=True)
        picture = Path(folder) / written
        numbers = picture.with_suffix(".json")
        if not numbers.is_file():
            return picture.read_bytes()
        return with_description(picture.read_bytes(), json.dumps(json.loads(numbers.read_text(encoding="utf-8"))))


# Of each picture in docs/images the commands, in an empty folder, what the last of them writes, and how it is compared.
PICTURES: dict[str, tuple[tuple[str, ...], str, Callable[[bytes, bytes], bool]]] = {
    "demo.png": (("tools/demo.py --out demo --seed 1",), "demo/hands.png", shows_the_same_hands),
    "synthetic.png": (
        ("tools/make_synthetic.py --out data --train 64 --test 480 --workers 1",
         "tools/show_data.py data/test.txt --frames 24 --plain --out synthetic.png"), "synthetic.png", alike),
}
