"""Pictures in documents are compared by their pixels or, where a fit drew them, by the hands they show."""

from __future__ import annotations

import copy
import json
from typing import Any

import cv2
import numpy as np

from docs.making.pictures import alike, described, shows_the_same_hands, with_description

HANDS: list[dict[str, Any]] = [
    {"hand": "right", "confidence": 0.98, "error_mm": 4.0, "positions_mm": [[1.0, 2, 3]], "angles_rad": {"a": 0.1}},
    {"hand": "left", "confidence": 0.5, "error_mm": 30.0, "positions_mm": [[4.0, 5, 6]], "angles_rad": {"a": 0.2}},
]
PICTURE = np.random.default_rng(0).integers(0, 255, (40, 60, 3), np.uint8)


def png(image: np.ndarray) -> bytes:
    """Return the image as a PNG file."""
    return cv2.imencode(".png", image)[1].tobytes()


def shown(image: np.ndarray, hands: list[dict[str, Any]]) -> bytes:
    """Return the image as a file that describes these hands."""
    return with_description(png(image), json.dumps(hands))


def test_pixels_decide() -> None:
    """A few pixels may differ; another picture, another size or a missing picture is different."""
    moved = PICTURE.copy()
    moved[:2, :2] = 0
    assert alike(png(PICTURE), png(PICTURE))
    assert alike(png(PICTURE), png(moved))
    assert not alike(png(PICTURE), png(PICTURE[::-1]))
    assert not alike(png(PICTURE), png(PICTURE[:-1]))
    assert not alike(b"", png(PICTURE))


def test_hands_decide() -> None:
    """Pictures of hands differ by size, number of hands, sides, joints and figures, not by pixels."""
    there = shown(PICTURE, HANDS)
    assert described(there) == HANDS and described(png(PICTURE)) is None
    np.testing.assert_array_equal(cv2.imdecode(np.frombuffer(there, np.uint8), cv2.IMREAD_UNCHANGED), PICTURE)
    assert shows_the_same_hands(there, shown(PICTURE[::-1], HANDS))
    assert not shows_the_same_hands(there, shown(PICTURE[:-1], HANDS))
    assert not shows_the_same_hands(there, shown(PICTURE, HANDS[:1]))
    assert not shows_the_same_hands(png(PICTURE), png(PICTURE)) and not shows_the_same_hands(b"", there)
    changes = [("hand", "left", False), ("confidence", 0.96, True), ("confidence", 0.8, False),
               ("angles_rad", {"a": 3.0}, True),
               ("error_mm", 4.6, True), ("error_mm", 9.0, False),
               ("positions_mm", [[1, 3, 3.5]], True), ("positions_mm", [[1, 2, 9]], False),
               ("positions_mm", [], False)]
    for key, value, same in changes:
        other = copy.deepcopy(HANDS)
        other[0][key] = value
        assert shows_the_same_hands(there, shown(PICTURE, other)) == same, (key, value)
