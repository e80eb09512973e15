"""handpose/frames/segmentation.py"""

from __future__ import annotations

import numpy as np

from handpose.frames.cameras import NYU
from handpose.frames.crops import BACKGROUND, crop
from handpose.frames.segmentation import REACH_MM, alone

CUBE_MM = 300.0
CENTER = np.array([320.0, 240.0, 700.0])


def depths(**parts: tuple[slice, slice, float]) -> np.ndarray:
    """A depth image of rectangles at a depth, the later ones in front."""
    image = np.zeros((480, 640), np.float32)
    for rows, columns, d in parts.values():
        image[rows, columns] = d
    return image


def shown(image: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A crop with everything, and the hand alone."""
    whole = crop(image, CENTER, CUBE_MM, NYU)
    return whole, alone(whole, CENTER, CUBE_MM, NYU)


def test_a_table_and_the_forearm_are_removed() -> None:
    """A hand stays unchanged; a table behind it becomes background, and the arm ends at the reach."""
    hand = depths(hand=(slice(200, 280), slice(280, 360), 700.0))
    table = depths(table=(slice(0, 480), slice(0, 640), 740.0), hand=(slice(200, 280), slice(280, 360), 700.0))
    np.testing.assert_array_equal(shown(table)[1], shown(hand)[0])
    whole, arm = shown(depths(arm=(slice(200, 480), slice(300, 340), 700.0)))
    rows = np.flatnonzero((arm < BACKGROUND).any(axis=1))
    lengths = CUBE_MM / len(arm) * (rows[-1] - len(arm) / 2)
    assert abs(lengths - REACH_MM) < 5 and (whole[-4] < BACKGROUND).any()


def test_a_finger_in_front_of_the_palm_stays() -> None:
    """A surface within the reach belongs to the hand; one that continues beyond it, does not."""
    palm = (slice(200, 280), slice(280, 360), 720.0)
    whole, kept = shown(depths(palm=palm, finger=(slice(230, 250), slice(290, 300), 680.0)))
    np.testing.assert_array_equal(kept, whole)
    whole, kept = shown(depths(palm=palm, stick=(slice(0, 480), slice(285, 295), 660.0)))
    assert (whole < -0.2).any() and not (kept < -0.2).any()


def test_nothing_is_left_of_nothing() -> None:
    """A crop without a reading stays, and one with readings only beyond the reach becomes background."""
    assert (shown(depths())[1] == BACKGROUND).all()
    assert (shown(depths(corner=(slice(350, 360), slice(430, 440), 700.0)))[1] == BACKGROUND).all()
