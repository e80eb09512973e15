"""Decoding of image files with OpenCV.

A small file can claim to hold an image larger than memory. OpenCV checks the size before decoding
and rejects more than OPENCV_IO_MAX_IMAGE_PIXELS, which netlib/__init__.py sets to MAX_PIXELS.
This takes effect only if netlib is imported before cv2; otherwise OpenCV's own limit is four
times as large.
"""

from __future__ import annotations

import re

import cv2
import numpy as np

from netlib.blob import Array
from netlib.errors import DataError, reason_of

PNG = b"\x89PNG\r\n\x1a\n"  # at the start of a file
PNG_END = b"IEND\xaeB`\x82"  # the last chunk with its checksum
# Markers of JPEG. They do not occur in coded pixels.
JPEG, JPEG_SCAN, JPEG_END = b"\xff\xd8\xff", b"\xff\xda", b"\xff\xd9"
MAX_PIXELS = 1 << 28  # more than any camera has
# what the variable OPENCV_IO_MAX_IMAGE_... of the environment limits
LIMITED = {"PIXELS": "pixels in all", "WIDTH": "pixels in a row", "HEIGHT": "rows"}


def decode(content: bytes, flag: int, what: str) -> Array:
    """Decode an image file to pixels (H, W) or (H, W, C), blue first; ``flag`` is that
    of cv2.imdecode.

    Raises DataError that begins with ``what``. Some versions of OpenCV complete truncated images
    without an error, so the end of a PNG or JPEG file is checked first.
    """
    if content.startswith(PNG) and PNG_END not in content:
        raise DataError(f"{what}: truncated or damaged PNG")
    if content.startswith(JPEG) and content.rfind(JPEG_END) < content.rfind(JPEG_SCAN):
        raise DataError(f"{what}: truncated JPEG")
    try:
        image = cv2.imdecode(np.frombuffer(content, np.uint8), flag) if content else None
    except (cv2.error, MemoryError) as error:
        if isinstance(error, MemoryError) or getattr(error, "code", 0) == cv2.Error.STS_NO_MEM:
            raise DataError(f"{what}: no memory to decode the image") from MemoryError()
        raise DataError(f"{what}: {_rejection(error)}") from error
    if image is None:
        raise DataError(f"{what}: not an image that OpenCV can decode ({len(content)} bytes)")
    return np.asarray(image)


def _rejection(error: Exception) -> str:
    """Why OpenCV rejects an image, for messages."""
    exceeded = re.search(r"CV_IO_MAX_IMAGE_(PIXELS|WIDTH|HEIGHT)", str(error))
    if exceeded is None:
        return f"not an image that OpenCV can decode: {reason_of(error)}"
    limit = exceeded[1]
    return (
        f"the image has too many {LIMITED[limit]}; OPENCV_IO_MAX_IMAGE_{limit} in the environment "
        "raises the limit"
    )
