"""Sheets of pictures in rows, also of moments of a recording of any length."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from handpose.output.drawing.strokes import Image, text_within
from netlib.blob import divide_up
from netlib.errors import DataError

# In pixels: the height of a cell's title, and of that the part below its letters.
TITLE_HEIGHT, TITLE_DESCENT = 22, 7
TITLE_COLOUR = (40, 40, 40)
SHEET_COLUMNS, IMAGES_PER_PAGE = 4, 16  # of a page
MAX_IMAGE_WIDTH = 480  # pixels of an image; larger ones are reduced
PAGES = 4  # an even number


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
    head = TITLE_HEIGHT if titles else 0
    rows = divide_up(len(images), columns)
    columns = min(columns, len(images))
    cell_height, cell_width = height + head + gap, width + gap
    size = rows * cell_height + gap, columns * cell_width + gap
    canvas = np.full((*size, 3), 255, dtype=np.uint8)
    for n, image in enumerate(images):
        row, column = divmod(n, columns)
        top, left = gap + row * cell_height, gap + column * cell_width
        if titles:
            at = np.array([left, top + head - TITLE_DESCENT])
            text_within(canvas, titles[n], at, TITLE_COLOUR, 0.5, width)
        top += head + (height - image.shape[0]) // 2
        left += (width - image.shape[1]) // 2
        colour = cv2.cvtColor(image, cv2.COLOR_GRAY2BGR) if image.ndim == 2 else image
        canvas[top : top + image.shape[0], left : left + image.shape[1]] = colour
    return canvas


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
        size = MAX_IMAGE_WIDTH, height
        return np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA), dtype=np.uint8)
