"""handpose/output/drawing/strokes.py"""

from __future__ import annotations

import numpy as np

from handpose.output.drawing import strokes


def test_sheet() -> None:
    """Pictures of any size and depth are arranged in a grid, with titles above them."""
    pictures = [np.full((60, 40), 10, np.uint8), np.full((30, 80, 3), 20, np.uint8), np.full((60, 80), 30, np.uint8)]
    page = strokes.sheet(pictures, 2, ["one", "a title that is far too long for its cell", "three"])
    assert page.shape == (2 * (60 + 22 + 8) + 8, 2 * (80 + 8) + 8, 3)
    for value, picture in zip((10, 20, 30), pictures, strict=True):
        assert (page == value).all(axis=2).sum() >= picture.shape[0] * picture.shape[1]
    assert strokes.sheet(pictures[:1], 4).shape == (60 + 16, 40 + 16, 3)
