"""A recording of any length on one page: images at equal intervals."""

from __future__ import annotations

from collections.abc import Callable

import cv2
import numpy as np

from handpose.drawing import strokes
from handpose.drawing.strokes import Image
from netlib.errors import DataError

PAGES = 4  # an even number


class ContactSheet:
    """Collects images of an unknown number of frames, and keeps at most four full pages.

    Every frame is taken until the four pages are full. Then every second image is dropped, and only every second
    further frame is taken, and so on. At the end one page is chosen from those two to four pages.

    width  of each image in pixels; larger ones are reduced
    """

    def __init__(self, columns: int = 4, rows: int = 4, width: int = 400) -> None:
        if columns < 1 or rows < 1 or width < 1:
            raise DataError(f"{columns} columns, {rows} rows, {width} pixels wide; expected at least 1 of each")
        self.columns, self.places, self.width = columns, columns * rows, width
        self._kept: list[tuple[float, Image]] = []
        self._step, self._count = 1, 0

    def add(self, time: float, draw: Callable[[], Image]) -> None:
        """Add a frame at a time in s; its image is drawn only if it is taken."""
        if self._count % self._step == 0:
            if len(self._kept) == PAGES * self.places:
                self._kept, self._step = self._kept[::2], 2 * self._step
            self._kept.append((time, self._reduced(draw())))
        self._count += 1

    def times(self) -> list[float]:
        """The times of the images on the page."""
        return [time for time, _ in self._chosen()]

    def page(self) -> Image:
        """The images, each with its time above it. Raises DataError if there are none."""
        images = [image for _, image in self._chosen()]
        return strokes.sheet(images, self.columns, [f"{time:.2f} s" for time in self.times()])

    def _chosen(self) -> list[tuple[float, Image]]:
        count = min(len(self._kept), self.places)
        return [self._kept[round(n * (len(self._kept) - 1) / max(count - 1, 1))] for n in range(count)]

    def _reduced(self, image: Image) -> Image:
        if image.shape[1] <= self.width:
            return image
        height = max(round(image.shape[0] * self.width / image.shape[1]), 1)
        return np.asarray(cv2.resize(image, (self.width, height), interpolation=cv2.INTER_AREA), dtype=np.uint8)
