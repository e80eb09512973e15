"""Depth images as grey images, with a contrast that follows the hands slowly, so that a video does not flicker."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from netlib.blob import Array

SECONDS = 1.0  # time constant of a change of contrast
SPREAD_MM = 130.0  # in front of and behind the hands: the range with most of the greys
_MAX_DEPTH = (1 << 14) - 1  # mm; everything beyond is equally dark
_DARK, _LIGHT = 28.0, 225.0


class Contrast:
    """The mapping from depth to grey: nearer is lighter, steepest at the hands, black without a reading."""

    def __init__(self) -> None:
        self._middle: float | None = None  # mm
        self._spread = SPREAD_MM
        self._time = 0.0
        self._known = False  # True once a hand was seen

    def see(self, time: float, depth: NDArray[np.floating], hands: Array) -> None:
        """Follow the depths (n,) in mm of all joints at a time in s; until there are some, the nearest objects."""
        if len(hands):
            middle, spread = (hands.max() + hands.min()) / 2, SPREAD_MM + (hands.max() - hands.min()) / 4
        elif not self._known:
            middle, spread = _nearest(depth), SPREAD_MM
        else:
            middle, spread = self._middle, self._spread
        part = 1.0 if self._middle is None else 1 - np.exp(-max(time - self._time, 0.0) / SECONDS)
        self._middle = middle if self._middle is None else self._middle + part * (middle - self._middle)
        self._spread += part * (spread - self._spread)
        self._time, self._known = time, self._known or len(hands) > 0

    @property
    def middle(self) -> float:
        """The depth in mm with medium grey."""
        assert self._middle is not None, "see() comes first"
        return self._middle

    @property
    def spread(self) -> float:
        """The distance in mm from ``middle`` that spans half of the greys of one side."""
        return self._spread

    def grey(self, depth: NDArray[np.floating]) -> NDArray[np.uint8]:
        """The image (height, width) of a depth image in mm."""
        away = (np.arange(_MAX_DEPTH + 1) - self.middle) / self.spread
        shades = np.rint(_DARK + (_LIGHT - _DARK) * (0.5 - 0.5 * away / (1 + np.abs(away)))).astype(np.uint8)
        shades[0] = 0
        return np.asarray(shades[np.minimum(depth, _MAX_DEPTH).astype(np.uint16)])


def _nearest(depth: NDArray[np.floating]) -> float:
    """The depth of the foreground in mm."""
    read = depth[::4, ::4]
    read = read[read > 0]
    return float(np.percentile(read, 10)) if len(read) else 700.0
