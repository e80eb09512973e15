"""Estimate the size of a hand from its first seconds; then size and bones are constant."""

from __future__ import annotations

import numpy as np

from handpose.estimate.hand import Hand
from handpose.fit.body import MAX_SIZE, MIN_SIZE, SIZE
from handpose.fit.observation import HandCrops
from handpose.fit.search import FAST
from handpose.fit.size_calibration import calibrate_size
from handpose.tracking.pose_estimator import PoseEstimator
from netlib.errors import DataError

FRAMES = 32  # number of poses collected
BEST = 16  # number of the poses that are used, the least uncertain ones
EVERY = 0.1  # s between poses, which must differ
CONFIDENT = 0.5
NEAR = np.linspace(-0.12, 0.12, 9)  # logarithms of the sizes tried, about the median of the single fits
POPULATION = 0.114  # deviation of the logarithm of the sizes of the recipe `people`


def checked(size: float) -> float:
    """The size relative to the skeleton. Raises DataError if hands of this size cannot be fitted."""
    if not MIN_SIZE <= size <= MAX_SIZE:
        raise DataError(f"size {size:g}, expected {MIN_SIZE} to {MAX_SIZE} times the skeleton's")
    return size


class SizeKeeper:
    """Collects poses of one hand until its size can be estimated.

    thickness  of the hand, estimated with its size; 1 before
    """

    def __init__(self, estimator: PoseEstimator) -> None:
        self._estimator = estimator
        self._estimates: list[Hand] = []
        self._time = -np.inf
        self.thickness = 1.0

    def take(self, estimate: Hand, time: float) -> float | None:
        """The size, relative to the skeleton, as soon as it is known, otherwise None."""
        if estimate.chance < CONFIDENT or time - self._time < EVERY:
            return None
        self._estimates = [*(one for one in self._estimates if one.hand == estimate.hand), estimate]
        self._time = time
        if len(self._estimates) < FRAMES:
            return None
        estimates, estimator = sorted(self._estimates, key=lambda one: one.uncertainty)[:BEST], self._estimator
        self._estimates = []
        crops, uvd = (np.stack(values) for values in zip(*((s.crop, s.center_uvd) for s in estimates)))
        hands = HandCrops.of_sides(crops, uvd, estimator.camera, estimator.cube_mm, estimate.hand)
        seen = hands.observe(FAST.points)
        x = np.stack([s.x for s in estimates])
        size = float(np.exp(np.median(x[:, SIZE])))
        middle = np.clip(np.log(size), np.log(MIN_SIZE) - NEAR[0], np.log(MAX_SIZE) - NEAR[-1])
        found = calibrate_size(estimator.fitter, seen, x, sizes=np.exp(middle + NEAR), deviation=POPULATION)
        self.thickness = found.thickness
        return found.size
