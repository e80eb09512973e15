"""Fit a skeleton to given joints by particle swarm optimisation, as the paper did for
its ground truth.

Needs no derivative, does a thousand times the work of ``fit_joints`` and ends with a worse result.
Kept for comparison.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import ArrayLike

from handpose.fit.joints.angles import rotations
from handpose.fit.joints.fit_joints import JointFit, PoseProblem, checked
from layers.hand.skeleton import Skeleton
from netlib.blob import Array
from netlib.engine import for_each
from netlib.errors import DataError

CONSTRICTION, ATTRACTION = 0.7298, 2.05  # Clerc and Kennedy (2002): the swarm contracts slowly
ROOT_REACH = 0.5  # of the root from the joints' mean, in the skeleton's unit


def fit_joints_by_swarm(
    skeleton: Skeleton,
    targets: ArrayLike,
    joints: Sequence[int] | None = None,
    *,
    particles: int = 128,
    generations: int = 200,
    seed: int = 0,
    progress: Callable[[int], None] = lambda done: None,
) -> JointFit:
    """Fit every frame independently, within the limits. Raises DataError.

    A particle is attracted to its own best position and to the best of all, with the constriction
    of Clerc and Kennedy (2002): v <- 0.7298 (v + 2.05 u1 (own best - x) + 2.05 u2 (best - x)). The
    cost is the sum of squared distances. Arguments as for ``fit_joints.fit_joints``.
    """
    goal, chosen = checked(skeleton, targets, joints)
    problem = PoseProblem(skeleton, chosen, limits=True, ridge=0.0)
    inputs = np.zeros((len(goal), len(skeleton.initial)))

    def job(n: int) -> None:
        inputs[n] = _swarm(
            problem, goal[n], particles, generations, np.random.default_rng([seed, n])
        )
        progress(1)

    for_each(range(len(goal)), job)
    return problem.result(inputs, goal, limits=True)


def _swarm(
    problem: PoseProblem, goal: Array, particles: int, generations: int, rng: np.random.Generator
) -> Array:
    """The best inputs (D,) for one frame's joints (K, 3)."""
    free = problem.free
    low, high = _bounds(problem, goal)
    x = rng.uniform(low, high, (particles, len(free)))
    v = np.zeros_like(x)
    inputs = np.zeros((particles, len(problem.skeleton.initial)))
    goals = np.broadcast_to(goal, (particles, *goal.shape))
    own, own_cost = x.copy(), np.full(particles, np.inf)
    for _ in range(generations):
        inputs[:, free] = x
        cost = problem.cost(inputs, goals)
        better = cost < own_cost
        own[better], own_cost[better] = x[better], cost[better]
        best = own[own_cost.argmin()]
        u1, u2 = rng.random((2, *x.shape))
        to_own, to_best = own - x, best - x
        v = CONSTRICTION * (v + ATTRACTION * u1 * to_own + ATTRACTION * u2 * to_best)
        x = np.clip(x + v, low, high)
    inputs[0, free] = own[own_cost.argmin()]
    return inputs[0]


def _bounds(problem: PoseProblem, goal: Array) -> tuple[Array, Array]:
    """The swarm's bounds, (F,) and (F,): within the limits, full circles for rotations, the root
    near the joints.
    """
    sk, free, centre = problem.skeleton, problem.free, np.nanmean(goal, axis=0)
    turning = np.isin(free, rotations(sk))
    low = np.where(turning, np.maximum(problem.lower, -np.pi), problem.lower)
    high = np.where(turning, np.minimum(problem.upper, np.pi), problem.upper)
    for i, dof in enumerate(free):
        initial = sk.initial[dof]
        if dof in problem.root_turns:
            low[i], high[i] = -np.pi - initial, np.pi - initial
        for motion in problem.root_moves:
            if dof == motion.dof:
                middle = motion.sign * centre[motion.axis] - initial
                low[i], high[i] = middle - ROOT_REACH, middle + ROOT_REACH
    low, high = np.clip((low, high), problem.lower, problem.upper)
    if not np.isfinite([low, high]).all():
        raise DataError(
            f"skeleton {sk.name!r} has translations without limits, where a swarm cannot begin"
        )
    return low, high
