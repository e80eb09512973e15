"""Pictures of documents are compared by their pixels, up to what rounding may move."""

from __future__ import annotations

import cv2
import numpy as np

from docs.making.pictures import alike


def png(image: np.ndarray) -> bytes:
    """The image as a file."""
    return cv2.imencode(".png", image)[1].tobytes()


def test_pixels_decide() -> None:
    """A few pixels may differ; another picture, another size, and no picture at all are others."""
    picture = np.random.default_rng(0).integers(0, 255, (40, 60, 3), np.uint8)
    moved = picture.copy()
    moved[:2, :2] = 0
    assert alike(png(picture), png(picture))
    assert alike(png(picture), png(moved))
    assert not alike(png(picture), png(picture[::-1]))
    assert not alike(png(picture), png(picture[:-1]))
    assert not alike(b"", png(picture))
