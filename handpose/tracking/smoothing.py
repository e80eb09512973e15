"""Poses smoothed over time: angles and the palm's pose, never joints, so that bones keep their length.

The palm's place goes through one One Euro filter with the speed of the point, its rotation through one of rotations,
every other variable through its own.
"""

from __future__ import annotations

from handpose.tracking.body_pose import Placed
from handpose.tracking.one_euro import Cutoff, OneEuro, OneEuroRotation

# Chosen on synthetic movements that no reported figure is of.
PLACE = Cutoff(least=0.5, slope=0.15, speed=4.0)  # per mm/s
ROTATION = Cutoff(least=0.5, slope=10.0, speed=3.0)  # per rad/s
OTHERS = Cutoff(least=0.3, slope=4.0, speed=1.5)  # per rad/s, and of sizes their logarithm


class PoseFilter:
    """Smooths one body."""

    def __init__(self) -> None:
        self._place = OneEuro(PLACE, together=True)
        self._rotation = OneEuroRotation(ROTATION)
        self._others = OneEuro(OTHERS)

    def __call__(self, body: Placed, time: float) -> Placed:
        """The smoothed body at a time in s; times ascend."""
        return Placed(
            self._place(body.place, time), self._rotation(body.rotation, time), self._others(body.others, time)
        )
