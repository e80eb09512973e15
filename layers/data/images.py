"""Picture files, as Caffe reads them with OpenCV: bytes (H, W, C), colours in the order blue, green, red."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

from netlib import files
from netlib.blob import Array
from netlib.errors import DataError
from netlib.files import pictures


def read_image(path: Path, color: bool) -> Array:
    """A picture in colour (C = 3) or in grey (C = 1). Raises DataError."""
    content = files.read_bytes(path, "the image")
    return decode_image(content, color, str(path))


def decode_image(content: bytes, color: bool | None, what: str) -> Array:
    """The picture in the bytes of a file; ``color`` None: with as many channels as it has. Raises DataError."""
    flag = {True: cv2.IMREAD_COLOR, False: cv2.IMREAD_GRAYSCALE, None: cv2.IMREAD_UNCHANGED}[color]
    image = pictures.decode(content, flag, what)
    if image.dtype != np.uint8:
        raise DataError(f"{what}: an image of {image.dtype}, expected 8 bits for each value")
    return image.reshape(*image.shape[:2], -1)


def resize_image(image: Array, height: int, width: int) -> Array:
    """The picture in another size, by linear interpolation; OpenCV drops a single channel, here it stays.

    Raises DataError for more pixels than a picture may have that is read.
    """
    if height * width > pictures.MOST_PIXELS:
        raise DataError(f"pictures resized to {width} x {height} pixels; expected at most {pictures.MOST_PIXELS}")
    return cv2.resize(image, (width, height), interpolation=cv2.INTER_LINEAR).reshape(height, width, -1)


def planes(image: Array) -> Array:
    """(H, W, C) as a blob has it, (C, H, W): a view."""
    return image.transpose(2, 0, 1)
