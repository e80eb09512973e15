"""Depth images: files that cameras and data sets write, each decoded once, and checks of arrays
passed from Python.

read_png      a PNG of a published data set, pixels unchanged; errors are kinds of bad frames, as
              reports name them
read_picture  any image that a user names
read_frame    an image that is a whole depth frame, in mm
read_crop     an image that is a crop, in [-1, 1]
depth_image   an array, in mm if ``check_unit`` accepts it; ``without_dropouts`` fills its single
              missing pixels
"""

from __future__ import annotations

import contextlib
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from handpose.frames.camera_file import NAME
from handpose.frames.cameras import NYU, Camera, View
from handpose.frames.crops import SIZE, numbers
from handpose.frames.recording import CameraInfo, DepthDecoder, NotDepthError, check_values
from netlib import files
from netlib.blob import Array
from netlib.errors import DataError, NetlibError, reason_of, system_error_of
from netlib.files import pictures
from netlib.files.paths import exists

# Kinds of errors in a published frame, as reports name them.
MISSING = "no such file"
DAMAGED = "truncated, damaged or no PNG"
WRONG_SIZE = "wrong size or type of image"
UNLABELLED = "a joint or the centre is not a number, or not before the camera"
OUTSIDE = "the cube lies outside the image"
EMPTY = "no depth around the hand"

ALIGNED = (
    "the name says that depth is aligned to another camera, usually that of the colours, whose "
    "fx, fy, u0 and v0 it then has: give --camera FX,FY,U0,V0"
)
OTHER_KIND = (
    "the name says disparities or infrared, and values are read as depth; expected depth, which is "
    "fx * baseline / disparity"
)
OTHER_KIND_NAME = re.compile("dispar|infra|(?<![a-z])(disp|ir)(?![a-z])", re.IGNORECASE)
ALIGNED_NAME = re.compile("(?<!un)(?<!not.)align(?!m)", re.IGNORECASE)
MAX_RED = 0.5  # maximum share of the pixels with red, which NYU's packing has not
MIN_IMAGE_MM, MAX_IMAGE_MM = 20.0, 20_000.0  # range of whole images of depth cameras


def read_png(path: str | Path) -> Array:
    """The unchanged pixels of a PNG file, colours in OpenCV's order (blue first).

    Raises BadFrameError.

    Raises another DataError if the system cannot read it, which is no flaw of the file.
    """
    if not exists(Path(path)):
        raise BadFrameError(path, MISSING)
    try:
        return read_picture(path)
    except DataError as error:
        if system_error_of(error):
            raise
        raise BadFrameError(path, DAMAGED) from None


def read_picture(path: str | Path) -> Array:
    """The pixels of an image file unchanged, colours in OpenCV's order (blue first).

    Raises DataError.
    """
    return pictures.decode(files.read_bytes(path, "the picture"), cv2.IMREAD_UNCHANGED, str(path))


@contextlib.contextmanager
def errors_of(where: str, what: str, damaged: str) -> Iterator[None]:
    """Turn any exception into a DataError: for a damaged file a library may raise any.

    what     is read; named if the system cannot read it
    damaged  what is wrong with the file otherwise
    """
    try:
        yield
    except NetlibError:
        raise
    except Exception as error:
        system = system_error_of(error)
        raise DataError(
            f"{where}: {f'cannot read {what}' if system else damaged}: "
            f"{reason_of(system or error)[:200]}"
        ) from error


def read_frame(path: str | Path, given: CameraInfo) -> NDArray[np.float32]:
    """A whole depth frame (height, width) in mm without distortion; 0 where there is no reading.

    Raises DataError.

    given  its camera, which is necessary
    """
    image = stored_depth(read_picture(path), given.camera, path)
    return DepthDecoder(image.shape, image.dtype, str(path), given)(image)


def is_aligned(path: Path, camera: Camera | View | None, origin: str) -> bool:
    """Whether the name of a frame or of its folder says that its depth is aligned to another
    camera, which this one may not be: it is if the user, or a camera.json, gives all numbers.

    origin  of the camera, as in ``CameraInfo``
    """
    is_meant = origin in ("", "--camera") or origin.endswith(NAME)
    if isinstance(camera, Camera) and is_meant:
        return False
    return ALIGNED_NAME.search(f"{path.parent.name}/{path.name}") is not None


def is_other_kind(*names: str) -> bool:
    """Whether the innermost name that says a kind of images says another one than depth."""
    for name in reversed(names):
        if "depth" in name.lower():
            return False
        if OTHER_KIND_NAME.search(name):
            return True
    return False


def stored_depth(
    image: NDArray[Any], camera: Camera | View | None, path: str | Path
) -> NDArray[Any]:
    """The stored depths of a grey image of 16 bits or more; of NYU's camera also those of its
    colour packing.

    Raises NotDepthError for other images.
    """
    if image.ndim == 3 and image.dtype == np.uint8 and image.shape[2] == 3:
        blue, green, red = cv2.split(image)
        if red.any() and green.any() and not blue.any():
            raise NotDepthError(
                f"{path}: colours with a byte of the depth in red and none in blue, as NYU's have not; expected a "
                "16-bit grey picture of 256 * green + red (--unit 1 for STB, 0.125 for HO-3D)"
            )
        if camera == NYU:
            if np.count_nonzero(red) > MAX_RED * red.size:
                raise NotDepthError(f"{path}: a picture of colours; NYU's packed depth has no red")
            return unpack_depth(image).astype(np.uint16)
    if image.ndim != 2 or image.dtype == np.uint8:
        kind, nyu = (
            ("colours", " (of the NYU data set, with --camera nyu)")
            if image.ndim == 3
            else ("grey values", "")
        )
        raise NotDepthError(
            f"{path}: a picture of {image.dtype} {kind}; expected depth, a 16-bit grey picture{nyu}"
        )
    return image


def read_crop(path: str | Path) -> NDArray[np.float32]:
    """A crop (128, 128) in [-1, 1] from an 8-bit grey picture: 0 is the near face, 255 the far one.

    Raises DataError.

    A square of another size is resized by nearest neighbour.
    """
    image = read_picture(path)
    if image.ndim == 3:
        image = image[..., 0] if np.ptp(image[..., :3], axis=2).max() == 0 else image
    if image.dtype != np.uint8 or image.ndim != 2:
        raise DataError(
            f"{path}: found {image.dtype} {image.shape}; expected an 8-bit grey picture of normalised "
            "depth (a whole depth frame is for predict.py, with its --camera)"
        )
    if image.shape[0] != image.shape[1]:
        raise DataError(
            f"{path}: {image.shape[1]} x {image.shape[0]} pixels; expected a square crop"
        )
    if image.shape != (SIZE, SIZE):
        image = cv2.resize(image, (SIZE, SIZE), interpolation=cv2.INTER_NEAREST)
    return (image / np.float32(127.5) - 1).astype(np.float32)


def unpack_depth(pixels: NDArray[np.uint8]) -> NDArray[np.float32]:
    """Depth (H, W) in mm of the pixels (H, W, 3), blue first, of an NYU frame: 256 green + blue;
    red is unused.
    """
    return pixels[..., 1].astype(np.float32) * 256 + pixels[..., 0]


class BadFrameError(DataError):
    """A frame that cannot be used; ``kind`` is one of the constants above."""

    def __init__(self, path: object, kind: str, detail: str = "") -> None:
        super().__init__(f"{path}: {kind}{detail and f' ({detail})'}")
        self.kind = kind


class UnitError(DataError):
    """The depths cannot be in mm."""


def depth_image(depth: object) -> NDArray[Any]:
    """The image (height, width), 0 where it is masked, NaN or infinite.

    Raises DataError for anything else, also for 8-bit values.
    """
    image = numbers(depth, "depth image", 0)
    if image.ndim != 2 or not image.size:
        raise DataError(f"depth image of shape {image.shape}, expected (height, width)")
    check_values(image.dtype, "depth image")
    if image.dtype.kind == "f" and not np.isfinite(image).all():
        return np.where(np.isfinite(image), image, image.dtype.type(0))
    return image


def without_dropouts(image: NDArray[Any]) -> NDArray[Any]:
    """The image in mm with the median of the neighbours in pixels without a reading of which at
    most one has none.

    In a crop, such a hole in a surface would be background, and its edge would be taken for flying
    pixels. Gaps between fingers are longer.
    """
    missing = ~(image > 0)
    around = cv2.boxFilter(
        missing.view(np.uint8), -1, (3, 3), normalize=False, borderType=cv2.BORDER_REPLICATE
    )
    alone = missing & (around <= 2)  # itself and one neighbour
    if not alone.any():
        return image
    medians = cv2.medianBlur(np.where(missing, 0, image).astype(np.float32), 3)
    return np.where(alone, medians.astype(image.dtype), image)


def check_unit(image: NDArray[Any], farthest: float = MAX_IMAGE_MM) -> None:
    """Raise UnitError if all depths are negative, too small for mm, or beyond ``farthest``.

    Single negative depths are allowed: some drivers write -1 where there is no reading.
    """
    finite = np.isfinite(image)
    seen = image[finite & (image > 0)]
    if not len(seen):
        seen = image[finite & (image < -MIN_IMAGE_MM)] if image.dtype.kind in "fi" else seen
    if not len(seen):
        return
    low, high = float(seen.min()), float(seen.max())
    if high < 0:
        raise UnitError(
            f"depths from {low:.6g} to {high:.6g}, expected mm, growing away from the camera"
        )
    if high < MIN_IMAGE_MM:
        raise UnitError(f"depths from {low:.3g} to {high:.3g}, expected mm; they may be metres")
    if low > farthest:
        raise UnitError(
            f"depths from {low:.6g} to {high:.6g}, expected mm, nearer than {MAX_IMAGE_MM:g}; check the unit"
        )
