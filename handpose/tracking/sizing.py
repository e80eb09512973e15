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
# Weights of the priors about single fits: strong ones would keep the size of these fits.
WEAK_LIMBS, WEAK_RIGID_MM = 0.1, 100.0
MAX_LEFT = 3  # times the usual least cost; a frame with more, at any size, does not count


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
        self._fitter = fitter
        self._settings = settings
        self._estimates: list[HandEstimate] = []
        self._time = -np.inf

    def take(self, estimate: HandEstimate, time: float) -> None:
        """Add a pose of a frame, from which the size may follow."""
        s = self._settings
        if self.size is not None or estimate.chance < s.min_confidence:
            return
        if time - self._time < s.min_interval_s:
            return
        self._time = time
        same_side = [one for one in self._estimates if one.hand == estimate.hand]
        self._estimates = [*same_side, estimate]
        if len(self._estimates) >= s.poses:
            self.size = self._estimated()
            self._estimates = []

    def _estimated(self) -> float:
        """The size by the half of the poses whose fits cost less."""
        count = self._settings.poses // 2
        last = self._estimates[-1]
        best = sorted(self._estimates, key=lambda one: one.cost)[:count]
        crops = np.stack([one.view_crop for one in best])
        center_uvd = np.stack([one.view_uvd for one in best])
        hands = HandCrops(crops, center_uvd, last.view_camera, last.cube_mm)
        seen = self._fitter.observe(hands, self._fitter.settings.search.fast)
        x = np.stack([one.x for one in best])
        size = float(np.exp(np.median(x[:, SIZE_INDEX])))
        least, most = np.log(MIN_SIZE) - NEAR[0], np.log(MAX_SIZE) - NEAR[-1]
        middle = np.clip(np.log(size), least, most)
        return size_of(
            self._fitter, seen, x, self._settings.stages, np.exp(middle + NEAR), POPULATION
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
    weights = replace(fitter.objective.weights, size=0.0, limbs=WEAK_LIMBS, rigid=WEAK_RIGID_MM)
    objective = Objective(fitter.model, weights)
    left = np.zeros((len(sizes), len(x)))
    for costs, size in zip(left, sizes):
        start = x.copy()
        start[:, SIZE_INDEX] = np.log(size)
        prior = objective.prior_of(start, fitter.precision)
        _, cost = fitter.search.descend(objective, start, seen, prior, stages)
        costs[:] = data_cost(cost.parts)
    least = left.min(axis=0)
    explained = left[:, least <= MAX_LEFT * np.median(least)]
    prior_cost = (np.log(sizes / TYPICAL_SIZE) / deviation) ** 2
    return lowest(sizes, explained.mean(axis=1) + prior_cost)


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
