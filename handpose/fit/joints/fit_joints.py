"""Fit a skeleton to given joints by Levenberg-Marquardt, many frames at once.

With A and b of the problem (``pose_problem``), each iteration solves for every frame

    (A + mu diag(A)) step  =  -b

accepts the step if it lowers the cost, and then decreases mu (mu / 3), otherwise increases it (4 mu). With limits,
steps are clipped to them, and an angle at a limit whose step would leave it is held.

``fit_joints`` starts several times (``starts``): first from the initial pose of the limbs in the best rotation of the
whole body; then in turn from the best so far with some limbs drawn again, and as at first but with all limbs drawn.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from handpose.fit.joints.pose_problem import JointFit, PoseProblem, RotationGrid, checked, limb_poses, redrawn_limbs
from handpose.fit.levenberg_marquardt import minimise
from layers.hand.skeleton import Skeleton
from netlib.blob import Array
from netlib.engine import for_each
from netlib.errors import DataError
from netlib.system.memory import blocks

Progress = Callable[[int], None]

CHUNK = 256  # frames per job of a thread
MIN_GAIN = 1e-7  # relative; a frame whose cost decreases by less is finished
EXACT = 5e-6  # root mean square distance of the joints at which a frame needs no other start

MIN_MU = 1e-12  # minimum damping; below it a step equals Gauss-Newton's, up to rounding
RIDGE = 1e-12  # if no known joint moves with an angle, its step is 0 / 1e-12


def fit_joints(
    skeleton: Skeleton,
    targets: ArrayLike,
    joints: Sequence[int] | None = None,
    *,
    limits: bool = True,
    ridge: float = 0.0,
    starts: int = 8,
    iterations: int = 100,
    seed: int = 0,
    progress: Progress = lambda done: None,
) -> JointFit:
    """Fit every frame independently. Results do not depend on the number of threads. Raises DataError.

    targets     (N, K, 3) joint positions; NaN for a joint that is unknown in a frame
    joints      indices of the K joints in the skeleton; by default all
    limits      keep the inputs within the skeleton's limits
    ridge       weight of the squared inputs (rotations of limbs) relative to the squared distances: pulls angles that
                the joints hardly determine towards the initial pose
    starts      number of starts; a frame that fits exactly is not started again
    iterations  maximum number per start
    seed        of the random starts
    progress    called by any thread with the number of further frames that are done
    """
    goal, chosen = checked(skeleton, targets, joints)
    if starts < 1 or iterations < 1 or not ridge >= 0:
        raise DataError(
            f"{starts} starts of {iterations} iterations with ridge {ridge:g}, expected 1 or more, ridge 0 or more"
        )
    problem = PoseProblem(skeleton, chosen, limits, ridge)
    grids = [RotationGrid(problem, limbs) for limbs in limb_poses(problem, 1 + (starts - 1) // 2, seed)]
    inputs = np.zeros((len(goal), len(skeleton.initial)))

    def job(rows: slice) -> None:
        rng = np.random.default_rng([seed, rows.start])
        inputs[rows] = _best(problem, grids, goal[rows], starts, iterations, rng)
        progress(rows.stop - rows.start)

    for_each(blocks(len(goal), CHUNK), job)
    return problem.result(inputs, goal, limits)


def _best(
    problem: PoseProblem,
    grids: Sequence[RotationGrid],
    goal: Array,
    starts: int,
    iterations: int,
    rng: np.random.Generator,
) -> Array:
    """Inputs (N, D) of the best of all starts."""
    inputs, cost = _descend(problem, grids[0].near(goal), goal, iterations)
    for start in range(1, starts):
        todo = np.flatnonzero(cost > EXACT**2 * len(problem.joints))
        if not len(todo):
            break
        trial = redrawn_limbs(problem.skeleton, inputs[todo], rng) if start % 2 else grids[start // 2].near(goal[todo])
        found, found_cost = _descend(problem, trial, goal[todo], iterations)
        better = found_cost < cost[todo]
        inputs[todo[better]], cost[todo[better]] = found[better], found_cost[better]
    return inputs


def _descend(problem: PoseProblem, inputs: Array, goal: Array, iterations: int) -> tuple[Array, Array]:
    """Minimise from ``inputs`` (N, D); returns inputs (N, D) and their cost (N,)."""

    def evaluate(x: Array, rows: NDArray[np.int_]) -> tuple[Array, Array, Array]:
        trial = inputs[rows]
        trial[:, problem.free] = x
        return problem.evaluate(trial, goal[rows])

    x, cost = minimise(evaluate, inputs[:, problem.free], problem.lower, problem.upper, iterations,
                       ridge=RIDGE, min_mu=MIN_MU, min_gain=MIN_GAIN)
    found = inputs.copy()
    found[:, problem.free] = x
    return found, cost
