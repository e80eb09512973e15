"""Depth images as grey images, with a contrast that follows the hands slowly, so that a video does not flicker."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from netlib.blob import Array

SECONDS = 0.7  # time constant of a change of contrast
SPREAD_MM = 90.0  # in front of and behind the hands: the range with most of the greys
_MAX_DEPTH = (1 << 14) - 1  # mm; everything beyond is equally dark
_DARK, _LIGHT = 40.0, 230.0


class Contrast:
    """The mapping from depth to grey: nearer is lighter, steepest at the hands, black without a reading."""

    def __init__(self) -> None:
        self._middle: float | None = None  # mm
        self._spread: float | None = None  # mm
        self._time = 0.0

    def see(self, time: float, depth: NDArray[np.floating], hands: Array) -> None:
        """Follow the depths (n,) in mm of all joints at a time in s; without any, the nearer half of the scene."""
        if len(hands):
            middle, spread = (hands.max() + hands.min()) / 2, SPREAD_MM + (hands.max() - hands.min()) / 4
        else:
            middle, spread = _nearer_half(depth)
        part = 1.0 if self._middle is None else 1 - np.exp(-max(time - self._time, 0.0) / SECONDS)
        self._middle = middle if self._middle is None else self._middle + part * (middle - self._middle)
        self._spread = spread if self._spread is None else self._spread + part * (spread - self._spread)
        self._time = time

    @property
    def middle(self) -> float:
        """The depth in mm with medium grey."""
        assert self._middle is not None, "see() comes first"
        return self._middle

    @property
    def spread(self) -> float:
        """The distance in mm from ``middle`` that spans seven tenths of the greys of one side."""
        assert self._spread is not None, "see() comes first"
        return self._spread

    def grey(self, depth: NDArray[np.floating]) -> NDArray[np.uint8]:
        """The image (height, width) of a depth image in mm."""
        away = (np.arange(_MAX_DEPTH + 1) - self.middle) / self.spread
        shades = np.rint(_DARK + (_LIGHT - _DARK) * (0.5 - 0.5 * away / np.hypot(1, away))).astype(np.uint8)
        shades[0] = 0
        return np.asarray(shades[np.minimum(depth, _MAX_DEPTH).astype(np.uint16)])


def _nearer_half(depth: NDArray[np.floating]) -> tuple[float, float]:
    """The middle and half of the range in mm that contains the nearer half of the readings."""
    read = depth[::4, ::4]
    read = read[read > 0]
    near, far = np.percentile(read, (2, 50)) if len(read) else (600.0, 800.0)
    return float(near + far) / 2, max(float(far - near) / 2, SPREAD_MM)
