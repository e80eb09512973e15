"""Sheets of pictures: a recording of any length on one page, and predicted hands next to annotated ones."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from handpose.frames.cameras import NYU, Camera
from handpose.output.drawing import hands, strokes
from handpose.output.drawing.strokes import Image
from layers.hand.skeleton import Skeleton
from netlib.blob import Array

COLUMNS, PLACES = 4, 16  # of a page
WIDTH = 480  # pixels of an image; larger ones are reduced
PAGES = 4  # an even number
LEGEND = "in colour: predicted; thin white, in space thin black: annotated"


class ContactSheet:
    """Collects images of an unknown number of frames, and keeps at most four full pages.

    Every frame is taken until the four pages are full. Then every second image is dropped, and only every second
    further frame is taken, and so on. At the end one page is chosen from those two to four pages.
    """

    def __init__(self) -> None:
        self._kept: list[tuple[float, Image]] = []
        self._step, self._count = 1, 0

    def add(self, time: float, draw: Callable[[], Image]) -> None:
        """Add a frame at a time in s; its image is drawn only if it is taken."""
        if self._count % self._step == 0:
            if len(self._kept) == PAGES * PLACES:
                self._kept, self._step = self._kept[::2], 2 * self._step
            self._kept.append((time, self._reduced(draw())))
        self._count += 1

    def times(self) -> list[float]:
        """The times of the images on the page."""
        return [time for time, _ in self._chosen()]

    def page(self) -> Image:
        """The images, each with its time above it. Raises DataError if there are none."""
        images = [image for _, image in self._chosen()]
        return strokes.sheet(images, COLUMNS, [f"{time:.2f} s" for time in self.times()])

    def _chosen(self) -> list[tuple[float, Image]]:
        count = min(len(self._kept), PLACES)
        return [self._kept[round(n * (len(self._kept) - 1) / max(count - 1, 1))] for n in range(count)]

    def _reduced(self, image: Image) -> Image:
        if image.shape[1] <= WIDTH:
            return image
        height = max(round(image.shape[0] * WIDTH / image.shape[1]), 1)
        return np.asarray(cv2.resize(image, (WIDTH, height), interpolation=cv2.INTER_AREA), dtype=np.uint8)


def two_views(
    crops: Sequence[NDArray[np.floating]],
    joints: Array,
    truth: Array,
    skeleton: Skeleton,
    titles: Sequence[tuple[str, str]],
    columns: int = 6,
    centers: Array | None = None,
    camera: Camera = NYU,
    cube_mm: Sequence[float] = (),
) -> Image:
    """Every body on its crop and in space: the predicted one in colour, the annotated one in thin white and black.

    joints  (n, K, 3) half-cubes, all joints of the skeleton
    truth   (n, L, 3) annotated joints; drawn only if L is K
    titles  of the two views of each frame; a legend stands above all
    centers, camera, cube_mm  of the crops, (n, 3) px, px, mm; without them the projection is parallel
    """
    images = []
    for n, crop in enumerate(crops):
        annotated = truth[n] if len(truth[n]) == len(joints[n]) else None
        if centers is None:
            images.append(hands.overlay(crop, joints[n], skeleton, annotated, zoom=3))
        else:
            images.append(hands.overlay(crop, joints[n], skeleton, annotated, centers[n], cube_mm[n], camera, zoom=3))
        images.append(hands.view_3d(joints[n], skeleton, annotated, size=384))
    page = strokes.sheet(images, columns, [title for pair in titles for title in pair])
    legend = np.full((24, page.shape[1], 3), 255, dtype=np.uint8)
    strokes.text_within(legend, LEGEND, np.array([8, 18]), (40, 40, 40), 0.5, page.shape[1] - 16)
    return np.concatenate([legend, page])
