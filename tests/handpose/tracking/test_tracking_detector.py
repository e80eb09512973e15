"""handpose/tracking/detector.py, with a locator for which every block of a hand's width is a hand"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from handpose.estimate.locator import Locator
from handpose.frames.cameras import NYU
from handpose.frames.places import CUBE_MM, SIZE
from handpose.tracking.detector import NOWHERE, Detector

FRAME = 1 / 30


class Blocks(Locator):
    """Takes any object in front of a background for a hand, with the object's middle."""

    def __init__(self) -> None:
        self.seen: list[int] = []

    def look(self, crops: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Probabilities (N,) and offsets (N, 3) of the middles."""
        self.seen.append(len(crops))
        chance, where = np.zeros(len(crops)), np.zeros((len(crops), 3))
        for n, crop in enumerate(crops):
            row, column = np.nonzero(np.abs(crop) < 0.9)
            if 0.05 < len(row) / crop.size < 0.3:
                chance[n] = 0.9
                middle = np.array([column.mean() - SIZE / 2, SIZE / 2 - row.mean()]) * CUBE_MM / SIZE
                where[n] = (*middle, crop[row, column].mean() * CUBE_MM / 2)
        return chance, where

    @property
    def count(self) -> int:
        """The number of crops evaluated since the last access."""
        self.seen, seen = [], self.seen
        return sum(seen)


def room(*blocks: tuple[int, int, float]) -> np.ndarray:
    """A depth image of a wall at 1.5 m, with blocks of 15 cm about pixels (u, v) in front, at depths in mm."""
    depth = np.full((480, 640), 1500, np.float32)
    for u, v, d in blocks:
        half = round(75 * NYU.fx / d)
        depth[v - half : v + half, u - half : u + half] = d
    return depth


def middle(u: int, v: int, d: float) -> np.ndarray:
    """The middle of a block."""
    return NYU.unproject(np.array([u, v, d]))


def detector() -> tuple[Detector, Any]:
    """A detector and its locator."""
    locator: Any = Blocks()
    return Detector(locator, NYU), locator


def first_found(
    one: Detector, depth: np.ndarray, followed: np.ndarray, frames: int = 200
) -> tuple[int, np.ndarray] | None:
    """The first frame with a detection, and its place."""
    for n in range(frames):
        place = one.detect(depth, followed, n * FRAME)
        if place is not None:
            return n, place
    return None


LEFT_BLOCK, RIGHT_BLOCK = (180, 240, 700.0), (460, 200, 800.0)


def test_a_hand_is_found() -> None:
    """A hand is found within 8 frames, at the place given by the locator."""
    found = first_found(detector()[0], room(LEFT_BLOCK), NOWHERE)
    assert found is not None and found[0] < 8
    np.testing.assert_allclose(found[1], middle(*LEFT_BLOCK), atol=12)


def test_the_nearest_is_found_first() -> None:
    """The nearest hand is found first, because hands are held towards the camera."""
    found = first_found(detector()[0], room(LEFT_BLOCK, RIGHT_BLOCK), NOWHERE)
    assert found is not None
    np.testing.assert_allclose(found[1], middle(*LEFT_BLOCK), atol=12)


def test_a_further_hand_is_found_beside_one_that_is_followed() -> None:
    """A second hand is found, and the tracked one is not found again."""
    known = middle(*LEFT_BLOCK)[None]
    assert first_found(detector()[0], room(LEFT_BLOCK), known) is None
    found = first_found(detector()[0], room(LEFT_BLOCK, RIGHT_BLOCK), known)
    assert found is not None
    np.testing.assert_allclose(found[1], middle(*RIGHT_BLOCK), atol=12)


def test_no_frame_waits() -> None:
    """After the first frame few places are evaluated per frame, and fewer while a hand is tracked.

    The number per second does not depend on the rate, and there is a pause between rounds.
    """

    def places(followed: np.ndarray, rate: int, seconds: int = 3) -> list[int]:
        one, locator = detector()
        counts = []
        for n in range(seconds * rate):
            one.detect(room(), followed, n / rate)
            counts.append(locator.count)
        return counts

    beside, alone = places(middle(*LEFT_BLOCK)[None], 30), places(NOWHERE, 30)
    whole = alone[0]
    assert 0 < max(beside[1:]) < max(alone[1:]) < whole / 5
    slow = places(middle(*LEFT_BLOCK)[None], 10)
    assert max(beside[1:]) < max(slow[1:]) < whole / 5 and sum(slow[1:]) == pytest.approx(sum(beside[1:]), rel=0.2)
    rounds, locator = detector()
    few = np.zeros((480, 640), np.float32)
    few[:200, :200] = 700  # a round over few places
    counts = []
    for n in range(90):
        rounds.detect(few, middle(*RIGHT_BLOCK)[None], n * FRAME)
        counts.append(locator.count)
    assert np.mean(np.array(counts) > 0) < 0.6 and sum(counts[60:]) > 0


def test_nothing_to_be_seen() -> None:
    """Without a hand, nothing is detected and no error is raised."""
    assert first_found(detector()[0], np.zeros((480, 640), np.float32), NOWHERE, 3) is None
    assert first_found(detector()[0], room(), NOWHERE, 50) is None


def test_the_chance_of_a_place() -> None:
    """The probability is high at a block, and 0 at the wall and out of sight."""
    one, _ = detector()
    depth = room(LEFT_BLOCK)
    assert one.probability(depth, middle(*LEFT_BLOCK)) == pytest.approx(0.9)
    assert one.probability(depth, np.array([300.0, 0, 1500])) == 0
    assert one.probability(depth, np.array([0.0, 0, -500])) == one.probability(depth, np.array([9e4, 0, 700])) == 0


def test_nothing_is_looked_for_on_an_arm() -> None:
    """A block is found, unless the arm of a tracked hand passes there."""
    left, right = (200, 240, 700.0), (440, 240, 700.0)
    depth, followed = room(left, right), middle(*left)[None]
    for arms, found in ((middle(*right)[None] + (30, 0, 0), False), (middle(*right)[None] + (0, 300, 0), True)):
        one, _ = detector()
        places = [one.detect(depth, followed, n * FRAME, arms) for n in range(45)]
        assert any(place is not None for place in places) == found


def test_a_place_that_was_no_hand() -> None:
    """A rejected place is skipped for 0.5 s, then for 1 s, while a hand is tracked; otherwise it is not skipped."""
    left, right = (200, 240, 700.0), (440, 240, 700.0)
    depth, followed = room(left, right), middle(*left)[None]
    one, _ = detector()
    found = []
    for n in range(100):
        place = one.detect(depth, followed, n * FRAME)
        if place is not None:
            one.reject(place, n * FRAME)
            found.append(n * FRAME)
    pauses = np.diff(found)
    assert len(pauses) >= 2 and pauses[0] >= 0.5 and pauses[1] >= 1.0
    alone, _ = detector()
    for n in range(45):
        place = alone.detect(room(right), NOWHERE, n * FRAME)
        if place is not None:
            alone.reject(place, n * FRAME)
            found.append(n)
    assert np.diff([n for n in found if isinstance(n, int)]).min() * FRAME < 0.5


def test_a_place_that_was_no_hand_comes_last() -> None:
    """While no hand is tracked, a rejected place is offered again only after another one."""
    depth = room((200, 240, 700.0), (440, 240, 700.0))
    one, _ = detector()
    places = []
    for n in range(2):
        place = one.detect(depth, NOWHERE, float(n) / 4)
        assert place is not None
        one.reject(place, float(n) / 4)
        places.append(place)
    assert places[0][0] * places[1][0] < 0
