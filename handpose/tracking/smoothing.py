"""Poses smoothed over time: angles and the palm's pose instead of joints, so that bones keep their length.

The palm's position has a One Euro filter with the speed of the point, its rotation one for rotations, and every other
variable its own.
"""

from __future__ import annotations

import math

from handpose.fit.world_pose import WorldPose
from handpose.tracking.one_euro import Cutoff, OneEuro, OneEuroRotation

# Chosen on synthetic movements with three cameras that are in no reported result.
PLACE = Cutoff(least=0.5, slope=0.4, speed=2.7, noise=1.3, most=25.0)  # per mm/s
ROTATION = Cutoff(least=0.8, slope=45.0, speed=4.0, noise=2.1, most=0.5)  # per rad/s
OTHERS = Cutoff(least=0.8, slope=15.0, speed=0.75, noise=1.05, most=0.4)  # per rad/s, and of sizes their logarithm
GOOD_MM = 30.0  # expected error of a pose above which it is trusted less; smaller errors last, so smoothing only delays
POWER = 3  # exponent of the ratio of the errors
MIN_TRUST = 0.1  # minimum trust, because a hand may move meanwhile


class PoseFilter:
    """Smooths the poses of one body."""

    def __init__(self) -> None:
        self._place = OneEuro(PLACE, together=True)
        self._rotation = OneEuroRotation(ROTATION)
        self._others = OneEuro(OTHERS)

    def __call__(self, body: WorldPose, time: float, error_mm: float = math.nan) -> WorldPose:
        """The smoothed body at a time in s; times ascend.

        error_mm  expected error of its joints; NaN if unknown
        """
        trust = 1.0 if math.isnan(error_mm) else max((GOOD_MM / max(error_mm, GOOD_MM)) ** POWER, MIN_TRUST)
        return WorldPose(
            self._place(body.place, time, trust),
            self._rotation(body.rotation, time, trust),
            self._others(body.others, time, trust),
        )
