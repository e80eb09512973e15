"""Pictures of depth as files: frames that cameras and data sets write, and crops. Every file is decoded once.

read_png      a PNG of a published data set, pixels as they are; what is wrong with it is a kind of bad frame
read_picture  any picture that a user names
read_frame    ... which is a whole depth frame, in mm
read_crop     ... which is a crop, in [-1, 1]
"""

from __future__ import annotations

import zlib
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from handpose.data.bad_frames import DAMAGED, MISSING, BadFrameError
from handpose.data.crops import SIZE
from handpose.facts.cameras import UNIT_MM, Camera
from netlib.blob import Array
from netlib.errors import DataError, reason_of

_PNG = b"\x89PNG\r\n\x1a\n"  # the first bytes of such a file


def read_png(path: str | Path) -> Array:
    """The pixels of a PNG file as they are, colours in OpenCV's order (blue first). Raises BadFrameError."""
    try:
        raw = Path(path).read_bytes()
    except FileNotFoundError:
        raise BadFrameError(path, MISSING) from None
    except OSError as error:
        raise BadFrameError(path, DAMAGED, reason_of(error)) from None
    if not raw.startswith(_PNG):
        raise BadFrameError(path, DAMAGED)
    try:
        return _decoded(raw)
    except ValueError:
        raise BadFrameError(path, DAMAGED) from None


def read_picture(path: str | Path) -> Array:
    """The pixels of a picture as they are, colours in OpenCV's order (blue first). Raises DataError."""
    try:
        raw = Path(path).read_bytes()
    except OSError as error:
        raise DataError(f"{path}: cannot read the picture: {reason_of(error)}") from error
    try:
        return _decoded(raw)
    except ValueError as error:
        raise DataError(f"{path}: not a picture that can be read{error}") from None


def read_frame(path: str | Path, camera: Camera, unit_mm: float | None = None) -> NDArray[np.float32]:
    """A whole depth frame (height, width) in mm; 0 where nothing was read. Raises DataError.

    path     a 16-bit grey picture; of the camera "nyu" also NYU's colour packing
    camera   which wrote it; one without a size takes frames of any
    unit_mm  what a pixel's value of 1 stands for; by default the camera's own unit
    """
    image = read_picture(path)
    unit = np.float32(unit_mm or UNIT_MM.get(camera.name, 1.0))
    if image.ndim == 3 and image.dtype == np.uint8 and camera.name == "nyu":
        depth = unpack_depth(image) * unit
    elif image.ndim == 2 and image.dtype == np.uint16:
        depth = image.astype(np.float32) * unit
    else:
        raise DataError(f"{path}: found {image.dtype} {image.shape}; expected a 16-bit grey PNG of depth")
    if camera.width and depth.shape != (camera.height, camera.width):
        raise DataError(f"{path}: {depth.shape[1]} x {depth.shape[0]} pixels; "
                        f"camera {camera.name} has {camera.width} x {camera.height}")  # fmt: skip
    return depth


def read_crop(path: str | Path) -> NDArray[np.float32]:
    """A crop (128, 128) in [-1, 1] from an 8-bit grey picture: 0 is the near face, 255 the far one. Raises DataError.

    A square of another size is resized by nearest neighbour.
    """
    image = read_picture(path)
    if image.ndim == 3:
        image = image[..., 0] if np.ptp(image[..., :3], axis=2).max() == 0 else image
    if image.dtype != np.uint8 or image.ndim != 2:
        raise DataError(f"{path}: found {image.dtype} {image.shape}; expected an 8-bit grey picture of normalised "
                        "depth (for a whole depth frame name its --camera)")  # fmt: skip
    if image.shape[0] != image.shape[1]:
        raise DataError(f"{path}: {image.shape[1]} x {image.shape[0]} pixels; expected a square crop")
    if image.shape != (SIZE, SIZE):
        image = np.asarray(cv2.resize(image, (SIZE, SIZE), interpolation=cv2.INTER_NEAREST))
    return (image / np.float32(127.5) - 1).astype(np.float32)


def unpack_depth(pixels: NDArray[np.uint8]) -> NDArray[np.float32]:
    """Depth (H, W) in mm of the pixels (H, W, 3), blue first, of an NYU frame: 256 green + blue; red is unused."""
    return pixels[..., 1].astype(np.float32) * 256 + pixels[..., 0]


def pack_depth(depth: ArrayLike) -> NDArray[np.uint8]:
    """The inverse of ``unpack_depth``: whole mm (H, W) below 65536 to the pixels (H, W, 3) of a frame."""
    mm = np.asarray(depth).astype(np.uint16)
    return np.stack([mm & 255, mm >> 8, np.zeros_like(mm)], axis=-1).astype(np.uint8)


def _decoded(raw: bytes) -> Array:
    """The pixels of a picture's file. Raises ValueError, which says why there are none, to go on a sentence with.

    A PNG file is first checked chunk by chunk, because some versions of OpenCV fill up a truncated picture.
    """
    if raw.startswith(_PNG) and not _is_whole_png(raw):
        raise ValueError(": truncated or damaged")
    try:
        image = cv2.imdecode(np.frombuffer(raw, np.uint8), cv2.IMREAD_UNCHANGED) if raw else None
    except cv2.error as error:
        raise ValueError(f": {str(error).splitlines()[0]}") from error
    if image is None:
        raise ValueError("; expected a grey PNG")
    return np.asarray(image)


def _is_whole_png(raw: bytes) -> bool:
    """Are all chunks there, each with the right checksum?"""
    at, view = len(_PNG), memoryview(raw)
    while at + 12 <= len(raw):
        end = at + 8 + int.from_bytes(raw[at : at + 4], "big")
        if zlib.crc32(view[at + 4 : end]) != int.from_bytes(raw[end : end + 4], "big"):
            return False
        if raw[at + 4 : at + 8] == b"IEND":
            return True
        at = end + 4
    return False
