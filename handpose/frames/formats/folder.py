"""Folders of depth frames: 16-bit grey images (PNG or TIFF), ordered and timed by their names.

open_folder(Path("frames"), given)          # all images in it, which must be one sequence
open_folder(Path("frames/left_*.png"), given)    # those of one
"""

from __future__ import annotations

import contextlib
import fnmatch
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from handpose.frames import camera_file
from handpose.frames.cameras import NYU
from handpose.frames.formats.frame_names import NamedFrames, in_order
from handpose.frames.images import read_picture, unpack_depth
from handpose.frames.raw import Calibration, calibration_of
from handpose.frames.recording import UNKNOWN, CameraInfo, DepthFrame, Recording
from netlib.errors import DataError, did_you_mean, reason_of, system_error_of
from netlib.files.paths import exists, list_folder, names_in

PICTURES = (".png", ".tif", ".tiff")
OTHERS = (".jpg", ".jpeg", ".bmp", ".exr", ".pgm", ".raw")  # named in an error message


def open_folder(source: Path, given: CameraInfo = UNKNOWN) -> FolderRecording:
    """The frames in a folder, or those matching a pattern of names, or one name. Raises DataError."""
    folder, names = _frames_in(source)
    camera_json = camera_file.next_to(folder)
    known = given.or_else(camera_json)
    packed = known.camera == NYU
    frames = in_order(names, str(folder), known.time_unit)
    path, image = _first_whole(folder, frames)
    raw = _grey(image, packed, path)
    if path.suffix.lower() in (".tif", ".tiff") and (pictures := cv2.imcount(str(path))) > 1:
        raise DataError(f"{path}: a TIFF of {pictures} pictures; expected one for each frame, or all in an .npy")
    calibration = calibration_of(given, UNKNOWN, camera_json, raw.shape, raw.dtype, str(path))
    return FolderRecording(source, folder, frames, calibration, packed)


class FolderRecording(Recording):
    """One image per frame. Damaged ones are left out, and ``remarks`` counts them.

    folder  of the frames
    """

    def __init__(
        self, source: Path, folder: Path, frames: NamedFrames, calibration: Calibration, packed: bool
    ) -> None:
        self.name = str(source)
        self.camera, self.unit_mm, self.count = calibration.camera, calibration.unit_mm, len(frames.names)
        self.rate = calibration.rate
        remarks = [frames.interpretation, *calibration.remarks]
        if not frames.ticks and len(frames.names) > 1:
            self.rate, assumed = calibration.paced()
            remarks += assumed
        self.remarks = self._remarks = tuple(remarks)
        self.folder, self._frames, self._packed = folder, frames, packed
        self._decode = calibration.decoder(self.name)

    def __iter__(self) -> Iterator[DepthFrame]:
        """The frames that can be read. Raises DataError for one of another size or kind, and for a system error."""
        damaged, first = 0, ""
        ticks = self._frames.ticks or self.rate or 1.0
        for number, (name, time) in enumerate(zip(self._frames.names, self._frames.times)):
            path = self.folder / name
            try:
                image = read_picture(path)
            except DataError as error:
                if system_error_of(error):
                    raise
                damaged, first = damaged + 1, first or str(error)
                self.remarks = (*self._remarks, f"{damaged} damaged frames are left out, the first: {first}")
                continue
            yield DepthFrame(number, time / ticks, self._decode(_grey(image, self._packed, path), str(path)))


def _frames_in(source: Path) -> tuple[Path, list[str]]:
    """The folder, and the names of all pictures in it, of those that fit a pattern, or of a single one."""
    if exists(source) and source.is_dir():
        names = [name for name in list_folder(source) if _is_frame(name)]
        if not names:
            raise DataError(_no_frames(source))
        return source, names
    if exists(source):
        return source.parent, [source.name]
    with contextlib.suppress(ValueError):  # a name that no file can have
        try:
            source.stat()
        except OSError as error:
            if system_error_of(error):
                raise DataError(f"{source}: cannot be read: {reason_of(error)}") from error
    there = list_folder(source.parent) if exists(source.parent) else set()
    names = [name for name in fnmatch.filter(there, source.name) if _is_frame(name)]
    if not names:
        pattern = any(character in source.name for character in "*?[")
        said = "no picture has such a name" if pattern else "no such file or folder"
        raise DataError(f"{source}: {said}{did_you_mean(source.name, there)}")
    return source.parent, names


def _is_frame(name: str) -> bool:
    return not name.startswith(".") and name.lower().endswith(PICTURES)


def _no_frames(folder: Path) -> str:
    """The error for a folder without frames, with what it contains."""
    names = sorted(names_in(folder))
    inner = [name for name in names if any(map(_is_frame, names_in(folder / name)))]
    others = sorted({suffix for name in names if (suffix := Path(name).suffix.lower()) in OTHERS})
    if inner:
        found = f"; {', '.join(inner[:6])} in it {'do' if len(inner) > 1 else 'does'}: name one"
    else:
        found = f", but {', '.join(others)}" if others else ""
    return f"{folder}: holds no depth frames (16-bit grey PNG or TIFF){found}"


def _first_whole(folder: Path, frames: NamedFrames) -> tuple[Path, NDArray[Any]]:
    """The first frame that can be read. Raises DataError if none can."""
    first = None
    for name in frames.names:
        try:
            return folder / name, read_picture(folder / name)
        except DataError as error:
            if system_error_of(error):
                raise
            first = first or error
    assert first is not None
    raise first


def _grey(image: NDArray[Any], packed: bool, path: Path) -> NDArray[Any]:
    """The stored depths of an image; ``packed`` means NYU's packing. Raises DataError for other images."""
    if packed and image.ndim == 3 and image.dtype == np.uint8 and image.shape[2] == 3:
        return unpack_depth(image).astype(np.uint16)
    if image.ndim != 2 or image.dtype == np.uint8:
        kind, nyu = ("colours", " (of the NYU data set, with --camera nyu)") if image.ndim == 3 else ("grey values", "")
        raise DataError(f"{path}: a picture of {image.dtype} {kind}; expected depth, a 16-bit grey picture{nyu}")
    return image
