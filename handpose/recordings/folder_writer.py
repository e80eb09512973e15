"""Folders of 16-bit PNG that ``folder`` reads back: a frame's name is its time, camera.json says the rest.

camera.json  000000000000us.png  000000033333us.png  000000066667us.png
"""

from __future__ import annotations

import re
from pathlib import Path

import cv2

from handpose.facts.cameras import Camera
from handpose.recordings import camera_file
from handpose.recordings.given import Given
from handpose.recordings.raw import stored
from handpose.recordings.recording import DepthFrame
from netlib import atomic
from netlib.errors import DataError, NetlibError
from netlib.paths import names_in

OURS = re.compile(r"\d{12,}us\.png")
MICRO = 10**6


class FolderWriter:
    """Writes each frame at once, whole or not at all; times are rounded to microseconds.

    replace  a recording that was written in the same way; nothing else is ever removed
    """

    def __init__(self, path: Path, camera: Camera, unit_mm: float, rate: float | None, replace: bool = False) -> None:
        self._path, self._unit, self._last = path, unit_mm, -1
        old = [name for name in names_in(path) if not name.startswith(".")]
        foreign = sorted(name for name in old if not OURS.fullmatch(name) and name != camera_file.NAME)
        if old and (foreign or not replace):
            held = f"holds {foreign[0]}, which no recording has" if foreign and replace else "is not empty"
            raise NetlibError(f"{path}: {held}; name a new folder" + ("" if replace else " or replace it by --force"))
        path.mkdir(parents=True, exist_ok=True)
        for name in filter(OURS.fullmatch, old):  # before their camera.json is replaced: no frame is ever without one
            (path / name).unlink()
        camera_file.write(path / camera_file.NAME, Given(camera, unit_mm=unit_mm, rate=rate))

    def write(self, frame: DepthFrame) -> None:
        """Add a frame. Raises DataError, OSError."""
        where = f"{self._path}: frame {frame.number}"
        micro = round(frame.time * MICRO)
        if micro <= self._last:
            raise DataError(f"{where}: at {frame.time:.6f} s, which is not after the frame before")
        content = cv2.imencode(".png", stored(frame.depth, self._unit, where))[1].tobytes()
        atomic.replace(self._path / f"{micro:012d}us.png", lambda fresh: fresh.write_bytes(content), sync=False)
        self._last = micro

    def close(self) -> None:
        """Have the names reach the disk."""
        atomic.sync_directory(self._path)
