"""Estimate the size of a hand from its first seconds; then size and bones are constant.

In one frame, a larger hand farther away looks nearly the same, and a bent limb looks like a short
one. All frames of a person have the same size, so several are fitted again with each of some sizes,
each from its own fit. The result is the size with the least total cost, by a parabola through the
three lowest. Frames count robustly, because some are fitted wrongly at any size.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from handpose.estimate.hand import HandEstimate
from handpose.fit.body import MAX_SIZE, MIN_SIZE, SIZE_INDEX, TYPICAL_SIZE
from handpose.fit.depth_fit import DepthFitter
from handpose.fit.objective import Objective
from handpose.fit.observation import HandCrops, Observation
from handpose.fit.search import data_cost
from handpose.fit.settings import Stage
from handpose.tracking.settings import SizeSettings
from netlib.blob import Array
from netlib.errors import DataError

# logarithms of the sizes tried, about the median of the single fits
NEAR = np.linspace(-0.12, 0.12, 9)
POPULATION = 0.114  # deviation of the logarithm of the sizes of the recipe `people`


def checked(size: float) -> float:
    """The size relative to the skeleton.

    Raises DataError if hands of this size cannot be fitted.
    """
    if not MIN_SIZE <= size <= MAX_SIZE:
        raise DataError(f"size {size:g}, expected {MIN_SIZE} to {MAX_SIZE} times the skeleton's")
    return size


class SizeKeeper:
    """Collects poses of one hand until its size can be estimated.

    size  relative to the skeleton; None until it is known
    """

    def __init__(
        self, fitter: DepthFitter, settings: SizeSettings, size: float | None = None
    ) -> None:
        self.size = size
        self._fitter, self._settings = fitter, settings
        self._estimates: list[HandEstimate] = []
        self._time = -np.inf

    def take(self, estimate: HandEstimate, time: float) -> None:
        """Add a pose of a frame, from which the size may follow."""
        is_known, s = self.size is not None, self._settings
        if is_known or estimate.chance < s.min_confidence or time - self._time < s.min_interval_s:
            return
        self._estimates = [*(one for one in self._estimates if one.hand == estimate.hand), estimate]
        self._time = time
        if len(self._estimates) < s.poses:
            return
        estimates = sorted(self._estimates, key=lambda one: one.uncertainty)[: s.poses // 2]
        self._estimates = []
        crops, uvd = (
            np.stack(values)
            for values in zip(*((one.view_crop, one.view_uvd) for one in estimates))
        )
        hands = HandCrops(crops, uvd, estimate.view_camera, estimate.cube_mm)
        seen = self._fitter.observe(hands, self._fitter.settings.search.fast)
        x = np.stack([one.x for one in estimates])
        size = float(np.exp(np.median(x[:, SIZE_INDEX])))
        least, most = np.log(MIN_SIZE) - NEAR[0], np.log(MAX_SIZE) - NEAR[-1]
        middle = np.clip(np.log(size), least, most)
        self.size = size_of(
            self._fitter, seen, x, s.stages, sizes=np.exp(middle + NEAR), deviation=POPULATION
        )


def size_of(
    fitter: DepthFitter,
    seen: Observation,
    x: Array,
    stages: Sequence[Stage],
    sizes: Array,
    deviation: float = np.inf,
) -> float:
    """The size, relative to the skeleton, of the hand in all frames, fitted as x (N, V).

    stages     of the fits
    sizes      to be tried: at least three, with equal steps of their logarithms
    deviation  of the logarithm of people's sizes about that of TYPICAL_SIZE. This prior counts as
               much as one frame, however many there are, because the model differs from a hand in
               the same way in all of them.
    """
    # Weak priors: strong ones about poses that were fitted with another size would keep that size.
    objective = Objective(
        fitter.model, replace(fitter.objective.weights, size=0.0, limbs=0.1, rigid=100.0)
    )
    left = np.zeros((len(sizes), len(x)))
    for costs, size in zip(left, sizes):
        start = x.copy()
        start[:, SIZE_INDEX] = np.log(size)
        prior = objective.prior_of(start, fitter.precision)
        _, cost = fitter.search.descend(objective, start, seen, prior, stages)
        costs[:] = data_cost(cost.parts)
    least = left.min(axis=0)
    explained = left[:, least <= 3 * np.median(least)]  # frames that no size explains do not count
    return lowest(sizes, explained.mean(axis=1) + (np.log(sizes / TYPICAL_SIZE) / deviation) ** 2)


def lowest(sizes: Array, values: Array) -> float:
    """The minimum of a parabola through the lowest value and its neighbours, over the
    logarithm of the size.
    """
    i = int(np.clip(values.argmin(), 1, len(sizes) - 2))
    before, here, after = values[i - 1 : i + 2]
    curve = before - 2 * here + after
    shift = 0.5 * (before - after) / curve if curve > 0 else np.sign(before - after)
    step = np.log(sizes[1] / sizes[0])
    return float(np.exp(np.log(sizes[i]) + np.clip(shift, -1, 1) * step))
