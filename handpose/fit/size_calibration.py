"""The size and thickness of one person's hand, from depth frames alone.

In one frame, a larger hand farther away looks nearly the same, and a bent limb looks like a short one. All frames of a
person have the same size, so all frames are fitted again with each of some sizes, each from its own fit. The result
is the size with the least total cost, by a parabola through the three lowest. Frames count robustly, because some are
fitted wrongly at any size.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from handpose.fit.body import SIZE, THICKNESS, TYPICAL_SIZE
from handpose.fit.depth_fit import STARTS_TOGETHER, DepthFitter
from handpose.fit.objective import Objective
from handpose.fit.observation import Observation
from handpose.fit.search import Stage, data_cost, descend
from netlib.blob import Array
from netlib.errors import DataError
from netlib.system.memory import blocks

MIN_FRAMES = 5  # frames needed to estimate a size
STAGES = (Stage(15, 4), Stage(10, 3))


class HandSize(NamedTuple):
    """The estimated size of one hand."""

    size: float  # relative to the skeleton
    thickness: float  # scale of the radii, relative to a skeleton of this size


def calibrate_size(
    fitter: DepthFitter, seen: Observation, x: Array, sizes: Array, deviation: float = np.inf
) -> HandSize:
    """Estimate the size of the hand in all frames, fitted as x (N, V). Raises DataError for too few frames.

    sizes      to be tried: at least three, with equal steps of their logarithms
    deviation  of the logarithm of people's sizes about that of TYPICAL_SIZE. This prior counts as much as one frame,
               however many there are, because the model differs from a hand in the same way in all of them.
    """
    if len(x) < MIN_FRAMES:
        raise DataError(f"{len(x)} frames to estimate a hand's size from, expected {MIN_FRAMES} or more")
    # Weak priors: strong ones about poses that were fitted with another size would keep that size.
    weights = replace(fitter.objective.weights, size=0.0, limbs=0.1, rigid=100.0)
    objective = Objective(fitter.model, weights)
    left, thicknesses = np.zeros((2, len(sizes), len(x)))
    for i, size in enumerate(sizes):
        for rows in blocks(len(x), STARTS_TOGETHER):
            start = x[rows].copy()
            start[:, SIZE] = np.log(size)
            prior = objective.prior_of(start, fitter.precision)
            found, cost = descend(objective, start, seen.take(rows), prior, STAGES)
            left[i, rows], thicknesses[i, rows] = data_cost(cost.parts), found[:, THICKNESS]
    bounded = np.minimum(left, 3 * np.median(left.min(axis=0)))  # frames that no size explains do not count
    bounded += (np.log(sizes / TYPICAL_SIZE) / deviation)[:, None] ** 2
    whole = _lowest(sizes, bounded.mean(axis=1))
    thickness = float(np.exp(np.median(thicknesses[np.abs(np.log(sizes / whole)).argmin()])))
    return HandSize(whole, thickness)


def _lowest(sizes: Array, values: Array) -> float:
    """The minimum of a parabola through the lowest value and its neighbours, over the logarithm of the size."""
    i = int(np.clip(values.argmin(), 1, len(sizes) - 2))
    before, here, after = values[i - 1 : i + 2]
    curve = before - 2 * here + after
    shift = 0.5 * (before - after) / curve if curve > 0 else np.sign(before - after)
    step = np.log(sizes[1] / sizes[0])
    return float(np.exp(np.log(sizes[i]) + np.clip(shift, -1, 1) * step))
