"""Drawing with subpixel precision: lines, dots and text; and sheets of pictures, also of a
recording of any length.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from netlib.blob import Array, divide_up
from netlib.errors import DataError

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


def sheet(
    images: Sequence[NDArray[np.uint8]], columns: int, titles: Sequence[str] = (), gap: int = 8
) -> Image:
    """Pictures in rows of ``columns``, each centred in a cell of the largest size,
    with titles above.
    """
    if not images or columns < 1:
        raise DataError(
            f"{len(images)} pictures in {columns} columns, expected at least one of each"
        )
    height, width = (max(image.shape[axis] for image in images) for axis in (0, 1))
    head = 22 if titles else 0
    rows = divide_up(len(images), columns)
    columns = min(columns, len(images))
    cell_height, cell_width = height + head + gap, width + gap
    size = rows * cell_height + gap, columns * cell_width + gap
    canvas = np.full((*size, 3), 255, dtype=np.uint8)
    for n, image in enumerate(images):
        row, column = divmod(n, columns)
        top, left = gap + row * cell_height, gap + column * cell_width
        if titles:
            text_within(
                canvas, titles[n], np.array([left, top + head - 7]), (40, 40, 40), 0.5, width
            )
        top += head + (height - image.shape[0]) // 2
        left += (width - image.shape[1]) // 2
        colour = cv2.cvtColor(image, cv2.COLOR_GRAY2BGR) if image.ndim == 2 else image
        canvas[top : top + image.shape[0], left : left + image.shape[1]] = colour
    return canvas


SHEET_COLUMNS, IMAGES_PER_PAGE = 4, 16  # of a page
MAX_IMAGE_WIDTH = 480  # pixels of an image; larger ones are reduced
PAGES = 4  # an even number


class ContactSheet:
    """Collects images of an unknown number of frames, and keeps at most four full pages.

    Every frame is taken until the four pages are full. Then every second image is dropped, and
    only every second further frame is taken, and so on. At the end one page is chosen from those
    two to four pages.
    """

    def __init__(self) -> None:
        self._kept: list[tuple[float, Image]] = []
        self._step = 1
        self._count = 0

    def add(self, time: float, draw: Callable[[], Image]) -> None:
        """Add a frame at a time in s; its image is drawn only if it is taken."""
        if self._count % self._step == 0:
            if len(self._kept) == PAGES * IMAGES_PER_PAGE:
                self._kept = self._kept[::2]
                self._step = 2 * self._step
            self._kept.append((time, self._reduced(draw())))
        self._count += 1

    def times(self) -> list[float]:
        """The times of the images on the page."""
        return [time for time, _ in self._chosen()]

    def page(self) -> Image:
        """The images, each with its time above it. Raises DataError if there are none."""
        images = [image for _, image in self._chosen()]
        return sheet(images, SHEET_COLUMNS, [f"{time:.2f} s" for time in self.times()])

    def _chosen(self) -> list[tuple[float, Image]]:
        count = min(len(self._kept), IMAGES_PER_PAGE)
        last = len(self._kept) - 1
        steps = max(count - 1, 1)
        return [self._kept[round(n * last / steps)] for n in range(count)]

    def _reduced(self, image: Image) -> Image:
        if image.shape[1] <= MAX_IMAGE_WIDTH:
            return image
        height = max(round(image.shape[0] * MAX_IMAGE_WIDTH / image.shape[1]), 1)
        return np.asarray(
            cv2.resize(image, (MAX_IMAGE_WIDTH, height), interpolation=cv2.INTER_AREA),
            dtype=np.uint8,
        )
