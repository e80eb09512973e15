"""Levenberg-Marquardt within limits, for many frames at once: the step, and the loops.

A step solves (A + mu diag A) step = -b. It is accepted if it lowers the cost; then mu decreases, otherwise mu
increases. A variable at a limit whose step would leave it is held.

minimise  fits of joints, by a function for the cost and its derivatives
descend   fits of depth, by the objective. A step is lengthened, and a part of the previous step is added. The robust
          distance may decrease from stage to stage: at first far points count, at the end only those that the model
          explains.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from handpose.fit.objective import Cost, Objective, Prior
from handpose.fit.observation import Observation
from handpose.fit.rounding import FIT_STEP, rounded
from netlib.blob import Array

# TRUST and DISTRUST are the factors of mu after an accepted and a rejected step. The results depend little on them:
# with 1/2 and 2, or 1/10 and 10, the same minima are found (to 0.01%) with up to a third more work. FIRST_MU from 0.001
# to 0.1 is equally good; with 1 the first steps are so small that frames stop too early.
FIRST_MU, TRUST, DISTRUST = 1e-2, 1 / 3, 4
MAX_MU = 1e8  # maximum damping of ``minimise``; larger steps are lost in rounding
EXACT_COST = 1e-24  # (1e-12)², the rounding error of the positions of a few joints

LOW_MU, HIGH_MU = 1e-5, 1e4  # limits of the damping of ``descend``
RIDGE = 1e-9  # of ``descend``
# The nearest points slide along the surface as it moves, so a step is too short, and the next one has the same
# direction.
FURTHER, MOMENTUM = 1.5, 0.2

T = TypeVar("T", bound=Any)
Evaluate = Callable[[Array, NDArray[np.int_]], tuple[Array, Array, Array]]


def damped_step(A: Array, b: Array, mu: Array, x: Array, lower: Array, upper: Array, ridge: float) -> Array:
    """The steps (N, F) that solve (A + mu diag(A) + ridge) step = -b; A is used up.

    A             (N, F, F) the normal matrix
    b             (N, F) half the gradient of the cost
    mu            (N,) damping
    x             (N, F) the variables, between lower and upper; one at a limit whose step would leave it gets 0
    lower, upper  (F,)
    ridge         keeps a variable without influence constant
    """
    held = ((x <= lower) & (b > 0)) | ((x >= upper) & (b < 0))
    diagonal = np.arange(A.shape[1])
    A[:, diagonal, diagonal] *= 1 + mu[:, None]
    A[:, diagonal, diagonal] += ridge
    A[held[:, :, None] | held[:, None, :]] = 0
    A[:, diagonal, diagonal] += held
    return np.asarray(np.linalg.solve(A, np.where(held, 0, -b)[..., None])[..., 0])


def minimise(
    evaluate: Evaluate, x: Array, lower: Array, upper: Array, iterations: int, *, ridge: float, min_mu: float = 0.0,
    min_gain: float | None = None,
) -> tuple[Array, Array]:
    """Minimise from x (N, F) between lower and upper (F,); returns x and its cost (N,).

    evaluate  of x (n, F) and the numbers (n,) of their frames: cost (n,), normal matrix (n, F, F), half gradient (n, F)
    min_mu    lower bound of the damping
    min_gain  a frame whose cost decreases by less, relative to it, is finished; None: all frames run to the end
    """
    x, mu, rows = x.copy(), np.full(len(x), FIRST_MU), np.arange(len(x))
    cost, A, b = evaluate(x, rows)
    for _ in range(iterations):
        step = damped_step(A.copy(), b, mu[rows], x[rows], lower, upper, ridge)
        trial = np.clip(x[rows] + step, lower, upper)
        trial_cost, trial_A, trial_b = evaluate(trial, rows)
        better, gain = trial_cost < cost[rows], cost[rows] - trial_cost
        finished = better & (gain <= (min_gain or 0.0) * cost[rows])
        accepted = rows[better]
        x[accepted], cost[accepted] = trial[better], trial_cost[better]
        A[better], b[better] = trial_A[better], trial_b[better]
        mu[rows] = np.maximum(mu[rows] * np.where(better, TRUST, DISTRUST), min_mu)
        if min_gain is None:
            continue
        active = ~finished & (mu[rows] < MAX_MU) & (cost[rows] > EXACT_COST)
        rows, A, b = rows[active], A[active], b[active]
        if not len(rows):
            break
    return x, cost


class Stage(NamedTuple):
    """A number of iterations with one robust distance; a fit ends earlier once its cost decreases by too little."""

    robust: float  # mm
    iterations: int
    min_gain: float = 0.0  # relative decrease of the cost in an iteration


def descend(
    objective: Objective, x: Array, seen: Observation, prior: Prior, stages: tuple[Stage, ...]
) -> tuple[Array, Cost]:
    """Minimise the objective from x (N, V); returns x after all stages, and its cost."""
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
            mu = np.clip(mu * np.where(better, TRUST, DISTRUST), LOW_MU, HIGH_MU)
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
