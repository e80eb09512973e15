"""Frames of published data sets of hands, recognised by their files: NYU, ICVL, MSRA15.

NYU     depth_1_0000001.png   the first camera's depth, packed into the colours of 640 x 480
ICVL    Depth/.../image_0000.png, 16-bit grey, 320 x 240, below a file of labels
MSRA15  000000_depth.bin      six int32 (width, height, left, top, right, bottom), then the box's float32 depths in mm
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from handpose.frames.cameras import ICVL, MSRA15, NYU, Camera
from handpose.frames.recording import CameraInfo
from netlib import files
from netlib.errors import DataError
from netlib.files.paths import names_in

NYU_FRAME = re.compile(r"depth_1_\d{7}\.png")
ICVL_FRAME = re.compile(r"image_\d{4,}\.png")
MSRA_FRAME = re.compile(r"\d{6}_depth\.bin")
ICVL_LABELS = {"labels.txt", "test_seq_1.txt", "test_seq_2.txt"}  # next to the folder Depth
MSRA_BOX = 6  # numbers before the depths


@dataclass(frozen=True)
class DataSet:
    """A published data set: its name, its camera, and the names of its depth frames."""

    name: str
    camera: Camera
    frame: re.Pattern[str]

    @property
    def given(self) -> CameraInfo:
        """The camera parameters of its frames."""
        return CameraInfo(self.camera, unit_mm=1.0, origin=f"the data set {self.name}")

    def frames(self, names: Iterable[str]) -> list[str]:
        """The names of depth frames among these."""
        return [name for name in names if self.frame.fullmatch(name)]


def recognised(folder: Path, names: Iterable[str]) -> DataSet | None:
    """The data set of a folder with these names, or None."""
    names = list(names)
    for known in (DataSet("NYU", NYU, NYU_FRAME), DataSet("MSRA15", MSRA15, MSRA_FRAME)):
        if known.frames(names):
            return known
    icvl = DataSet("ICVL", ICVL, ICVL_FRAME)
    depth = next((parent for parent in (folder, *folder.absolute().parents) if parent.name == "Depth"), None)
    return icvl if depth and icvl.frames(names) and ICVL_LABELS & names_in(depth.parent) else None


def read_msra(path: Path) -> NDArray[Any]:
    """A depth frame (height, width) in mm of MSRA15, 0 outside the box. Raises DataError."""
    content = files.read_bytes(path, "the frame", limit=1 << 24)
    start = 4 * MSRA_BOX
    width, height, left, top, right, bottom = (
        int.from_bytes(content[i : i + 4].ljust(4, b"\0"), "little", signed=True) for i in range(0, start, 4)
    )
    inside = 0 <= left <= right <= width == MSRA15.width and 0 <= top <= bottom <= height == MSRA15.height
    if not inside or len(content) != start + 4 * (right - left) * (bottom - top):
        raise DataError(f"{path}: {len(content)} bytes are no frame of MSRA15: six int32 of its size {MSRA15.width} x "
                        f"{MSRA15.height} and of a box in it, then the box's depths in float32")
    frame = np.zeros((height, width), np.float32)
    frame[top:bottom, left:right] = np.frombuffer(content, "<f4", offset=start).reshape(bottom - top, right - left)
    return frame
