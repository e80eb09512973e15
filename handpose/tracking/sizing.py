"""The size of a hand, from its first seconds; then it is kept, and its bones with it."""

from __future__ import annotations

import numpy as np

from handpose.fitting.depth.observation import joined
from handpose.fitting.depth.size_calibration import calibrate_size
from handpose.tracking.looking import Looker, Sight

FRAMES = 16  # that the size is told from
EVERY = 0.1  # s between them: poses must differ
CONFIDENT = 0.9


class SizeKeeper:
    """Collects sights of one hand until its size can be told."""

    def __init__(self, looker: Looker) -> None:
        self._looker = looker
        self._sights: list[Sight] = []
        self._time = -np.inf

    def take(self, sight: Sight, time: float) -> float | None:
        """The size, relative to the skeleton, as soon as it is known."""
        if sight.confidence < CONFIDENT or time - self._time < EVERY:
            return None
        self._sights.append(sight)
        self._time = time
        if len(self._sights) < FRAMES:
            return None
        x = np.concatenate([sight.fit.x for sight in self._sights])
        seen = joined([sight.seen for sight in self._sights])
        return calibrate_size(self._looker.fitter, seen, x).size
