"""Decoding of image files with OpenCV, and of the entries of Caffe's databases
(Datum), as in Caffe.

Images are bytes (H, W, C) in BGR order.
"""

from __future__ import annotations

import math
from pathlib import Path

import cv2
import numpy as np

from netlib import files
from netlib.blob import Array
from netlib.errors import DataError, WireError
from netlib.files import pictures
from netlib.proto import schema, wire
from netlib.proto.messages import Datum


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
        raise DataError(
            f"images resized to {width} x {height} pixels; expected at most {pictures.MAX_PIXELS}"
        )
    return cv2.resize(image, (width, height), interpolation=cv2.INTER_LINEAR).reshape(
        height, width, -1
    )


def planes(image: Array) -> Array:
    """View of (H, W, C) as (C, H, W), the layout of blobs."""
    return image.transpose(2, 0, 1)


def decode_datum(data: bytes, color: bool | None, what: str) -> tuple[Array, int]:
    """Decode values (C, H, W) and label of a Datum: bytes, floats or an encoded image.

    Raises DataError.

    ``color`` selects how images are decoded: True in colour, False in grey, None unchanged.
    """
    try:
        datum = schema.read(wire.decode(data, Datum, what), Datum)
    except WireError as error:
        raise DataError(f"{error}; expected a Datum") from None
    if datum.encoded:
        return planes(decode_image(datum.data, color, what)), datum.label
    shape = datum.channels, datum.height, datum.width
    values = np.frombuffer(datum.data, np.uint8) if datum.data else datum.float_data
    count = 0 if values is None else len(values)
    if values is None or min(shape) < 1 or count != math.prod(shape):
        raise DataError(f"{what}: a Datum with channels, height, width {shape} has {count} values")
    return values.reshape(shape), datum.label
