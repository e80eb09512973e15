"""Pictures that a command draws in seconds from what is packaged: run again, and compared by their pixels."""

from __future__ import annotations

import functools
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np

from docs.making.made import Made
from netlib.paths import ROOT

# Of each picture in docs/images the commands, in an empty folder, and what the last of them writes.
PICTURES: dict[str, tuple[tuple[str, ...], str]] = {
    "demo.png": (("tools/demo.py --out demo",), "demo/hands.png"),
    "synthetic.png": (
        ("tools/make_synthetic.py --out data --train 64 --test 480 --workers 1",
         "tools/show_data.py data/test.txt --frames 24 --plain --out synthetic.png"), "synthetic.png"),
}  # fmt: skip
CLOSE = 1.0  # grey levels, on average: a fit in other units of the last bit moves a line by a pixel


def made() -> Iterator[Made]:
    """All of them."""
    for name, (commands, written) in PICTURES.items():
        yield Made(ROOT / "docs" / "images" / name, functools.partial(_drawn, commands, written), alike)


def alike(there: bytes, wanted: bytes) -> bool:
    """Whether two pictures have the same size and nearly the same pixels."""
    if not there:
        return False
    a, b = (cv2.imdecode(np.frombuffer(png, np.uint8), cv2.IMREAD_UNCHANGED) for png in (there, wanted))
    if a is None or b is None or a.shape != b.shape:
        return False
    return float(np.abs(a.astype(float) - b).mean()) <= CLOSE


def _drawn(commands: tuple[str, ...], written: str) -> bytes:
    with tempfile.TemporaryDirectory() as folder:
        for command in commands:
            tool, *options = command.split()
            subprocess.run([sys.executable, str(ROOT / tool), *options], cwd=folder, check=True, capture_output=True)
        return (Path(folder) / written).read_bytes()
