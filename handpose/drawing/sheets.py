"""Sheets: pictures of any size side by side, in rows, with titles."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from handpose.drawing import strokes
from handpose.drawing.strokes import Image
from netlib.errors import DataError


def sheet(images: Sequence[NDArray[np.uint8]], columns: int, titles: Sequence[str] = (), gap: int = 8) -> Image:
    """Pictures in rows of ``columns``, each centred in a cell of the largest size, with titles above."""
    if not images or columns < 1:
        raise DataError(f"{len(images)} pictures in {columns} columns, expected at least one of each")
    if titles and len(titles) != len(images):
        raise DataError(f"{len(titles)} titles for {len(images)} pictures")
    height, width = (max(image.shape[axis] for image in images) for axis in (0, 1))
    head = 22 if titles else 0
    rows = -(-len(images) // columns)
    columns = min(columns, len(images))
    canvas = np.full((rows * (height + head + gap) + gap, columns * (width + gap) + gap, 3), 255, dtype=np.uint8)
    for n, image in enumerate(images):
        row, column = divmod(n, columns)
        top, left = gap + row * (height + head + gap), gap + column * (width + gap)
        if titles:
            strokes.text_within(canvas, titles[n], np.array([left, top + head - 7]), (40, 40, 40), 0.5, width)
        top, left = top + head + (height - image.shape[0]) // 2, left + (width - image.shape[1]) // 2
        colour = cv2.cvtColor(image, cv2.COLOR_GRAY2BGR) if image.ndim == 2 else image
        canvas[top : top + image.shape[0], left : left + image.shape[1]] = colour
    return canvas
