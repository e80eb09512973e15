"""Levenberg-Marquardt on the objective, for many fits at once, with limits.

A step solves (A + mu diag A) step = -b; it is made longer, and part of the step before is added; it is taken if it
lowers the cost, and then mu falls, else it grows. A variable at a limit that wants beyond it is held. The robust
distance may shrink from stage to stage: first far points pull, too, at the end only what the model explains.
"""

from __future__ import annotations

from typing import Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from handpose.depth_fit.objective import Cost, Objective, Prior
from handpose.depth_fit.observation import Observation
from handpose.joint_fit.damped_step import damped_step
from handpose.rounding import FIT_STEP, rounded
from netlib.blob import Array

# Little depends on the damping, as in ``handpose.joint_fit.levenberg_marquardt``.
FIRST_MU, TRUST, MISTRUST, SMALLEST_MU, LARGEST_MU = 1e-2, 1 / 3, 4.0, 1e-5, 1e4
RIDGE = 1e-9  # a variable that nothing depends on stays


# The nearest places slide along the flesh as it moves, so that a step falls short of where it aims, and the next one
# aims the same way.
FURTHER, MOMENTUM = 1.5, 0.2

T = TypeVar("T", bound=Any)


class Stage(NamedTuple):
    """Some iterations with one robust distance."""

    robust: float  # mm
    iterations: int


def descend(
    objective: Objective, x: Array, seen: Observation, prior: Prior, stages: tuple[Stage, ...]
) -> tuple[Array, Cost]:
    """x (N, V) after all stages, and its cost."""
    lower, upper = objective.model.lower, objective.model.upper
    x, mu = np.clip(rounded(x, FIT_STEP), lower, upper), np.full(len(x), FIRST_MU)
    measured, moved = objective.measure(x, seen, prior), np.zeros_like(x)
    for stage in stages:
        now = objective.weigh(measured, seen, stage.robust)
        for _ in range(stage.iterations):
            M, b = objective.equations(measured, now)
            step = damped_step(M, b, mu, x, lower, upper, RIDGE)
            trial = np.clip(rounded(x + FURTHER * step + MOMENTUM * moved, FIT_STEP), lower, upper)
            trial_measured = objective.measure(trial, seen, prior)
            found = objective.weigh(trial_measured, seen, stage.robust)
            better = found.total < now.total
            moved = np.where(better[:, None], trial - x, 0)
            x = _chosen(better, trial, x)
            measured, now = _chosen(better, trial_measured, measured), _chosen(better, found, now)
            mu = np.clip(mu * np.where(better, TRUST, MISTRUST), SMALLEST_MU, LARGEST_MU)
    return x, now


def _chosen(better: NDArray[np.bool_], new: T, old: T) -> T:
    """The rows of ``new`` that are better, else those of ``old``; of arrays, or of tuples of them."""
    if better.all():
        return new
    if isinstance(new, tuple):
        return type(new)(*(_chosen(better, n, o) for n, o in zip(new, old)))
    return np.where(better.reshape(-1, *[1] * (new.ndim - 1)), new, old)
