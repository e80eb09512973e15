"""Folders of 16-bit PNG that ``folder`` reads: a frame's name is its time; camera.json has the parameters.

camera.json  000000000000us.png  000000033333us.png  000000066667us.png
"""

from __future__ import annotations

import contextlib
import os
import re
import shutil
from pathlib import Path

import cv2

from handpose.frames import camera_file
from handpose.frames.cameras import Camera
from handpose.frames.raw import stored
from handpose.frames.recording import CameraInfo, DepthFrame
from netlib import files
from netlib.errors import DataError, NetlibError
from netlib.files import atomic
from netlib.files.paths import exists, names_in

OURS = re.compile(r"\d{12,}us\.png")
MICRO = 10**6


class FolderWriter:
    """Writes each frame at once, completely or not at all; times are rounded to microseconds.

    replace  a recording written in the same way; no other files are ever removed. It is kept until the end, when the
             new one, written next to it, replaces it, unless that has no frame or the disk has failed
    """

    def __init__(self, path: Path, camera: Camera, unit_mm: float, rate: float | None, replace: bool = False) -> None:
        self._path, self._unit, self._last, self._failed = path, unit_mm, -1, False
        old = [name for name in names_in(path) if not name.startswith(".")]
        foreign = sorted(name for name in old if not _is_ours(path / name))
        if old and (foreign or not replace):
            held = f"holds {foreign[0]}, which no recording has" if foreign and replace else "is not empty"
            raise NetlibError(f"{path}: {held}; name a new folder" + ("" if replace else " or replace it by --force"))
        if old and os.path.ismount(path):
            raise NetlibError(f"{path}: a disk is mounted there, which cannot be replaced; name a folder in it")
        self._is_new = not exists(path)
        files.make_folder(path)
        self._old = Path(os.path.realpath(path)) if old else None
        self._fresh = path
        with contextlib.ExitStack() as stack, atomic.error_names(path):
            if self._old:
                self._fresh = stack.enter_context(atomic.temporary_folder(self._old))
            camera_file.write(self._fresh / camera_file.NAME, CameraInfo(camera, unit_mm=unit_mm, rate=rate))
            self._stack = stack.pop_all()

    def write(self, frame: DepthFrame) -> None:
        """Add a frame. Raises DataError, OSError."""
        where = f"{self._path}: frame {frame.number}"
        micro = round(frame.time * MICRO)
        if micro <= self._last:
            raise DataError(f"{where}: at {frame.time:.6f} s, which is not after the frame before")
        content = cv2.imencode(".png", stored(frame.depth, self._unit, where))[1].tobytes()
        name = f"{micro:012d}us.png"
        try:
            with atomic.error_names(self._path / name):
                atomic.replace(self._fresh / name, lambda fresh: fresh.write_bytes(content), sync=False)
        except OSError:
            self._failed = True
            raise
        self._last = micro

    def discard(self) -> None:
        """Remove the frames so far, and the folder if it is new; an old recording is kept."""
        self._last = -1
        if not self._old:
            for name in names_in(self._path):
                if OURS.fullmatch(name) or name == camera_file.NAME:
                    (self._path / name).unlink()
            if self._is_new:
                self._path.rmdir()

    def close(self) -> None:
        """Sync the names to the disk and remove an old recording."""
        with atomic.error_names(self._path), self._stack:
            atomic.sync_directory(self._fresh)
            if self._old and self._last >= 0 and not self._failed:
                _take_place(self._fresh, self._old)


def _is_ours(path: Path) -> bool:
    """Whether this is a file of a recording, by its name; a folder of that name is not, and may hold others' files."""
    return bool(OURS.fullmatch(path.name) or path.name == camera_file.NAME) and (path.is_symlink() or not path.is_dir())


def _take_place(fresh: Path, path: Path) -> None:
    """Replace a recording by a folder; files that are not part of it move to the new one. Raises OSError."""
    old = atomic.sibling(path, "old")
    path.rename(old)
    try:
        fresh.rename(path)
    except BaseException:
        old.rename(path)
        raise
    for name in names_in(old):
        if not _is_ours(old / name):
            (old / name).rename(path / name)
    atomic.sync_directory(path.parent)
    shutil.rmtree(old)
