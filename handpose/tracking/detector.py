"""Search for further hands: a few places in every frame, so that no frame takes much longer.

The locator needs a tenth of a second or more for all places of a frame. Here one scan over the places of a frame is
distributed over the following frames; likely hands are then predicted as by ``HandPipeline.in_frame``.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from handpose.estimate.locator import Locator, odds_of
from handpose.frames.cameras import Camera
from handpose.frames.places import extent_around, surface_places
from handpose.tracking.pose_estimator import LIKELY
from netlib.blob import Array

ROUND, ROUND_ALONE = 0.5, 0.2  # s per scan with and without a tracked hand
MAX_RATE, MAX_RATE_ALONE = 120.0, 1500.0  # places per second at most
MAX_EXTENT = 0.5  # share of directions in which a surface continues: more are a table or a body
APART_MM, ARM_MM = 170.0, 100.0  # minimum distances from tracked hands and from their arms
TIMES = 2  # evaluations of a likely place, each at the predicted position
# A rejected place, such as an elbow, is skipped for a pause, which doubles each time. While no hand is tracked, it is
# offered only if there is no other.
REJECTED_MM, PAUSE, MAX_PAUSE = 100.0, 0.5, 4.0
NOWHERE = np.zeros((0, 3))


class Rejected(NamedTuple):
    """A place (3,) in mm that was not a hand, the pause in s for which it is skipped, and its end in s."""

    place: Array
    pause: float
    until: float


class Detector:
    """Scans the places of an image, some per frame."""

    def __init__(self, locator: Locator, camera: Camera) -> None:
        self.locator, self.camera = locator, camera
        self._left = NOWHERE
        self._begun = self._last = -np.inf
        self._a_second = 0.0
        self._rejected: list[Rejected] = []

    def reject(self, place: Array, time: float) -> None:
        """Skip the surroundings of a place (3,) in mm for a while, because it was not a hand."""
        recent = [r for r in self._rejected if time < r.until + MAX_PAUSE]
        near = [np.linalg.norm(r.place - place) < REJECTED_MM for r in recent]
        pause = min(max((2 * r.pause for r, is_near in zip(recent, near) if is_near), default=PAUSE), MAX_PAUSE)
        others = [r for r, is_near in zip(recent, near) if not is_near]
        self._rejected = [*others, Rejected(place, pause, time + pause)]

    def restart(self) -> None:
        """Scan all places of the next image at once."""
        self._left = self._left[:0]
        self._begun = self._last = -np.inf

    def probability(self, depth: NDArray[np.float32], middle: Array) -> float:
        """The probability of a hand at a place (3,) in mm, the highest while the locator moves to its prediction."""
        highest, places = 0.0, middle[None]
        for _ in range(1 + TIMES):
            chance, places = self.locator.at(depth, places, self.camera)
            highest = max(highest, float(chance.max(initial=0.0)))
            if highest >= LIKELY or not len(chance):
                break
        return highest

    def detect(self, depth: NDArray[np.float32], followed: Array, time: float, arms: Array = NOWHERE) -> Array | None:
        """The middle (3,) in mm of a possible hand; mostly None.

        followed  (H, 3) mm: middles of tracked hands
        arms      (A, 3) mm: places on their arms
        """
        seconds, self._last = time - self._last, time
        if seconds > ROUND:  # outdated places
            self._left = self._left[:0]
        lasts, most = (ROUND, MAX_RATE) if len(followed) else (ROUND_ALONE, MAX_RATE_ALONE)
        if not len(self._left):
            if len(followed) and time - self._begun < ROUND:
                return None
            self._left, self._begun = self._places(depth), time
            self._a_second = len(self._left) / lasts
        refused = np.array([r.place for r in self._rejected if time < r.until]).reshape(-1, 3)
        skipped = refused if len(followed) else NOWHERE
        left = self._left[_apart(self._left, followed, APART_MM) & _apart(self._left, skipped, REJECTED_MM)]
        count = min(seconds, lasts) * min(self._a_second, most) if np.isfinite(seconds) else np.inf
        count = int(min(max(np.ceil(count), 1), len(left)))
        some, self._left = left[:count], left[count:]
        for _ in range(1 + TIMES):
            chance, middle = self.locator.at(depth, some, self.camera)
            good = (chance > LIKELY) & _apart(middle, followed, APART_MM) & _apart(middle, arms, ARM_MM)
            new = good & _apart(middle, refused, REJECTED_MM)
            good = new if len(followed) or new.any() else good
            if not good.any():
                return None
            chance, middle = chance[good], middle[good]
            some = middle[np.argsort(-chance)][:4]
        return np.asarray(middle[np.argmax(odds_of(chance, middle))])

    def _places(self, depth: NDArray[np.float32]) -> Array:
        """All places: first those whose surface ends around them, the nearest first.

        Hands are held towards the camera, and most of a table or a body is no place for a hand.
        """
        places = surface_places(depth, self.camera)
        wide = extent_around(depth, places, self.camera) > MAX_EXTENT
        return places[np.lexsort((places[:, 2], wide))]


def _apart(places: Array, others: Array, least_mm: float) -> NDArray[np.bool_]:
    """True (N,) for places (N, 3) farther than this from all others (M, 3)."""
    distance = np.linalg.norm(places[:, None] - others, axis=2)
    return np.asarray(distance.min(axis=1, initial=np.inf) > least_mm)
