"""Looking for further hands while others are followed: a few places of every frame, so that no frame waits for it.

The locator sees all places of a frame in a tenth of a second and more. Here a round goes over the places of one frame
during the frames after it; those that may be hands are then looked at as ``Predictor.hands_at`` does.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from handpose.data.places import place_crops, surface_places
from handpose.facts.cameras import Camera
from handpose.predicting.locator import Locator, odds_of
from handpose.tracking.looking import LIKELY
from netlib.blob import Array

FEW, MANY = 3, 24  # places looked at in a frame while a hand is followed, and while none is ...
USUAL_RATE = 30.0  # ... at so many frames a second; at fewer, more
ROUND = 0.5  # s that a round takes at least, while a hand is followed
APART_MM = 170.0  # from the middles of hands that are followed
AGAIN = 2  # times that a likely place is looked at again, from where the hand was said to be


class Scout:
    """Goes over the places of an image, some per frame."""

    def __init__(self, locator: Locator, camera: Camera) -> None:
        self.locator, self.camera = locator, camera
        self._left = np.zeros((0, 3))
        self._begun = self._last = -np.inf

    def chance(self, depth: NDArray[np.float32], middle: Array) -> float:
        """The chance that there is a hand about a place (3,) in mm."""
        found, _ = self._seen(depth, middle[None])
        return float(found.max(initial=0.0))

    def look(self, depth: NDArray[np.float32], followed: Array, time: float) -> Array | None:
        """The middle (3,) in mm of what may be a hand, apart from those that are followed (H, 3); mostly None."""
        if not len(self._left):
            if len(followed) and time - self._begun < ROUND:
                return None
            self._left, self._begun = self._places(depth), time
        seconds = time - self._last if np.isfinite(self._last) else np.inf
        count = int(min((FEW if len(followed) else MANY) * max(seconds * USUAL_RATE, 1.0), len(self._left)))
        some, self._left, self._last = self._left[:count], self._left[count:], time
        if len(followed) and len(some):
            some = some[np.linalg.norm(some[:, None] - followed, axis=2).min(axis=1) > APART_MM]
        chance, middle = self._seen(depth, some)
        for _ in range(AGAIN):
            likely = chance > LIKELY
            chance, middle = self._seen(depth, middle[likely][np.argsort(-chance[likely])][:4])
        good = chance > LIKELY
        if len(followed) and good.any():
            good &= np.linalg.norm(middle[:, None] - followed, axis=2).min(axis=1) > APART_MM
        if not good.any():
            return None
        return np.asarray(middle[good][np.argmax(odds_of(chance[good], middle[good]))])

    def _places(self, depth: NDArray[np.float32]) -> Array:
        """All places, the nearest first: a hand is held towards the camera."""
        places = surface_places(depth, self.camera)
        return places[np.argsort(places[:, 2], kind="stable")]

    def _seen(self, depth: NDArray[np.float32], places: Array) -> tuple[Array, Array]:
        """Chances (n,) and middles (n, 3) of the places (N, 3) that are in sight."""
        crops, kept = place_crops(depth, places, self.camera)
        if not len(kept):
            return np.zeros(0), np.zeros((0, 3))
        chance, where = self.locator.look(crops)
        return chance, kept + where
