"""Levenberg-Marquardt minimisation of the objective within limits, for many fits at once.

A step solves (A + mu diag A) step = -b. It is lengthened, and a part of the previous step is added. It is accepted if
it lowers the cost; then mu decreases, otherwise mu increases. A variable at a limit whose step would leave it is held.
The robust distance may decrease from stage to stage: at first far points count, at the end only those that the model
explains.
"""

from __future__ import annotations

from typing import Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from handpose.fit.levenberg_marquardt import damped_step
from handpose.fit.objective import Cost, Objective, Prior
from handpose.fit.observation import Observation
from handpose.fit.rounding import FIT_STEP, rounded
from netlib.blob import Array

# The results depend little on the damping, as in ``handpose.fit.joints.fit_joints``.
FIRST_MU, TRUST, MISTRUST, MIN_MU, MAX_MU = 1e-2, 1 / 3, 4.0, 1e-5, 1e4
RIDGE = 1e-9  # keeps variables without influence constant


# The nearest points slide along the surface as it moves, so a step is too short, and the next one has the same
# direction.
FURTHER, MOMENTUM = 1.5, 0.2

T = TypeVar("T", bound=Any)


class Stage(NamedTuple):
    """A number of iterations with one robust distance; a fit ends earlier once its cost decreases by too little."""

    robust: float  # mm
    iterations: int
    min_gain: float = 0.0  # relative decrease of the cost in an iteration


def descend(
    objective: Objective, x: Array, seen: Observation, prior: Prior, stages: tuple[Stage, ...]
) -> tuple[Array, Cost]:
    """Minimise from x (N, V); returns x after all stages, and its cost."""
    lower, upper = objective.model.lower, objective.model.upper
    x, mu = np.clip(rounded(x, FIT_STEP), lower, upper), np.full(len(x), FIRST_MU)
    measured, moved = objective.measure(x, seen, prior), np.zeros_like(x)
    for stage in stages:
        now = objective.weigh(measured, seen, stage.robust)
        active = np.ones(len(x), bool)
        for _ in range(stage.iterations):
            M, b = objective.equations(measured, now)
            step = damped_step(M, b, mu, x, lower, upper, RIDGE)
            trial = np.clip(rounded(x + FURTHER * step + MOMENTUM * moved, FIT_STEP), lower, upper)
            trial_measured = objective.measure(trial, seen, prior)
            found = objective.weigh(trial_measured, seen, stage.robust)
            better = active & (found.total < now.total)
            active &= ~better | (now.total - found.total >= stage.min_gain * now.total)
            moved = np.where(better[:, None], trial - x, 0)
            x = _chosen(better, trial, x)
            measured, now = _chosen(better, trial_measured, measured), _chosen(better, found, now)
            mu = np.clip(mu * np.where(better, TRUST, MISTRUST), MIN_MU, MAX_MU)
            if not active.any():
                break
    return x, now


def _chosen(better: NDArray[np.bool_], new: T, old: T) -> T:
    """The rows of ``new`` where ``better``, elsewhere those of ``old``; for arrays and tuples of them."""
    if better.all():
        return new
    if not better.any():
        return old
    if isinstance(new, tuple):
        return type(new)(*(_chosen(better, n, o) for n, o in zip(new, old)))
    return np.where(better.reshape(-1, *[1] * (new.ndim - 1)), new, old)
