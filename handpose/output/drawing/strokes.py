"""Drawing with subpixel precision: lines, dots and text."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from netlib.blob import Array

Image = NDArray[np.uint8]  # (height, width, 3), OpenCV's colour order
Colour = tuple[int, int, int]  # blue, green, red

_SUBPIXEL = 4  # cv2 draws at multiples of 1 / 2**4 of a pixel
_MAX_COORDINATE = 1e4  # pixels


def line(canvas: Image, start: Array, stop: Array, colour: Colour, thick: int) -> None:
    """A line between two points (2,), x and y."""
    cv2.line(canvas, _fixed(start), _fixed(stop), colour, thick, cv2.LINE_AA, _SUBPIXEL)


def dot(canvas: Image, at: Array, radius: int, colour: Colour) -> None:
    """A filled circle about a point (2,)."""
    cv2.circle(canvas, _fixed(at), radius << _SUBPIXEL, colour, -1, cv2.LINE_AA, _SUBPIXEL)


def text(canvas: Image, words: str, at: Array, colour: Colour, scale: float) -> None:
    """Text with its lower left corner at a point (2,); ``scale`` is OpenCV's: 1 is about
    22 pixels high.
    """
    x, y = np.rint(at).astype(int)
    cv2.putText(
        canvas, words, (int(x), int(y)), cv2.FONT_HERSHEY_SIMPLEX, scale, colour, 1, cv2.LINE_AA
    )


def text_within(
    canvas: Image, words: str, at: Array, colour: Colour, scale: float, width: int
) -> None:
    """Draw text, smaller if necessary, at most ``width`` pixels wide."""
    text(canvas, words, at, colour, scale_within(words, scale, width))


def scale_within(words: str, scale: float, width: int) -> float:
    """The scale, or a smaller one, of a text at most ``width`` pixels wide."""
    return scale * min(1.0, width / max(text_width(words, scale), 1))


def text_width(words: str, scale: float) -> int:
    """Width in pixels of such a text."""
    return int(cv2.getTextSize(words, cv2.FONT_HERSHEY_SIMPLEX, scale, 1)[0][0])


def _fixed(point: Array) -> tuple[int, int]:
    """A point for cv2's drawing with ``shift``, clipped to the range of its integers."""
    # plain floats are faster
    x, y = (min(max(value, -_MAX_COORDINATE), _MAX_COORDINATE) for value in point.tolist())
    return round(x * 2**_SUBPIXEL), round(y * 2**_SUBPIXEL)
