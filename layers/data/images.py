"""Decoding of image files with OpenCV, as in Caffe: bytes (H, W, C) in BGR order."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

from netlib import files
from netlib.blob import Array
from netlib.errors import DataError
from netlib.files import pictures


def read_image(path: Path, color: bool) -> Array:
    """Read an image in colour (C = 3) or in grey (C = 1). Raises DataError."""
    content = files.read_bytes(path, "the image")
    return decode_image(content, color, str(path))


def decode_image(content: bytes, color: bool | None, what: str) -> Array:
    """Decode an image file; ``color`` None keeps the number of channels. Raises DataError."""
    flag = {True: cv2.IMREAD_COLOR, False: cv2.IMREAD_GRAYSCALE, None: cv2.IMREAD_UNCHANGED}[color]
    image = pictures.decode(content, flag, what)
    if image.dtype != np.uint8:
        raise DataError(f"{what}: image of type {image.dtype}, expected 8 bits per value")
    return image.reshape(*image.shape[:2], -1)


def resize_image(image: Array, height: int, width: int) -> Array:
    """Resize an image (H, W, C) by linear interpolation; a single channel is kept as an axis.

    Raises DataError if the result exceeds the limit for images.
    """
    if height * width > pictures.MAX_PIXELS:
        raise DataError(f"images resized to {width} x {height} pixels; expected at most {pictures.MAX_PIXELS}")
    return cv2.resize(image, (width, height), interpolation=cv2.INTER_LINEAR).reshape(height, width, -1)


def planes(image: Array) -> Array:
    """View of (H, W, C) as (C, H, W), the layout of blobs."""
    return image.transpose(2, 0, 1)
