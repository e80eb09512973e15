"""Search among several starts, by Levenberg-Marquardt within limits, for many frames at once.

A fit converges to the local minimum near its start. A network that confuses two limbs, or the front
and back of a body, starts in the wrong one. Further starts are the network's predictions in the
crop turned by quarters, and its prediction with limbs drawn from the distribution of its errors. A
few iterations for all starts on few points choose those that continue to the end.

A step solves (A + mu diag A) step = -b. It is accepted if it lowers the cost; then mu decreases,
otherwise mu increases. A variable at a limit whose step would leave it is held.

minimise  fits of joints, by a function for the cost and its derivatives
descend   fits of depth, by the objective. A step is lengthened, and a part of the previous step is
          added. The robust distance may decrease from stage to stage: at first far points count, at
          the end only those that the model explains.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from handpose.fit.body import CapsuleModel
from handpose.fit.objective import Cost, Objective, Prior
from handpose.fit.observation import Observation
from handpose.fit.rounding import FIT_STEP, rounded
from handpose.fit.settings import Plan, SearchSettings, Stage
from layers.hand.kinematics import rotation
from netlib.blob import Array

# TRUST and DISTRUST are the factors of mu after an accepted and a rejected step. The results depend
# little on them: with 1/2 and 2, or 1/10 and 10, the same minima are found (to 0.01%) with up to a
# third more work. FIRST_MU from 0.001 to 0.1 is equally good; with 1 the first steps are so small
# that frames stop too early.
FIRST_MU, TRUST, DISTRUST = 1e-2, 1 / 3, 4
MAX_MU = 1e8  # maximum damping of ``minimise``; larger steps are lost in rounding
EXACT_COST = 1e-24  # (1e-12)², the rounding error of the positions of a few joints

LOW_MU, HIGH_MU = 1e-5, 1e4  # limits of the damping of ``descend``
DESCENT_RIDGE = 1e-9  # of ``descend``

T = TypeVar("T", bound=Any)
Evaluate = Callable[[Array, NDArray[np.int_]], tuple[Array, Array, Array]]


def damped_step(
    A: Array, b: Array, mu: Array, x: Array, lower: Array, upper: Array, ridge: float
) -> Array:
    """The steps (N, F) that solve (A + mu diag(A) + ridge) step = -b; A is used up.

    A             (N, F, F) the normal matrix
    b             (N, F) half the gradient of the cost
    mu            (N,) damping
    x             (N, F) the variables, between lower and upper; one at a limit whose step would
                  leave it gets 0
    lower, upper  (F,)
    ridge         keeps a variable without influence constant
    """
    held = ((x <= lower) & (b > 0)) | ((x >= upper) & (b < 0))
    diagonal = np.arange(A.shape[1])
    A[:, diagonal, diagonal] *= 1 + mu[:, None]
    A[:, diagonal, diagonal] += ridge
    A[held[:, :, None] | held[:, None, :]] = 0
    A[:, diagonal, diagonal] += held
    return np.linalg.solve(A, np.where(held, 0, -b)[..., None])[..., 0]


def minimise(
    evaluate: Evaluate,
    x: Array,
    lower: Array,
    upper: Array,
    iterations: int,
    *,
    ridge: float,
    min_mu: float = 0.0,
    min_gain: float = 0.0,
) -> tuple[Array, Array]:
    """Minimise from x (N, F) between lower and upper (F,); returns x and its cost (N,).

    evaluate  of x (n, F) and the numbers (n,) of their frames: cost (n,), normal matrix (n, F, F),
              half gradient (n, F)
    min_mu    lower bound of the damping
    min_gain  a frame whose cost decreases by less, relative to it, is finished
    """
    x, mu, rows = x.copy(), np.full(len(x), FIRST_MU), np.arange(len(x))
    cost, A, b = evaluate(x, rows)
    for _ in range(iterations):
        step = damped_step(A.copy(), b, mu[rows], x[rows], lower, upper, ridge)
        trial = np.clip(x[rows] + step, lower, upper)
        trial_cost, trial_A, trial_b = evaluate(trial, rows)
        better = trial_cost < cost[rows]
        gain = cost[rows] - trial_cost
        finished = better & (gain <= min_gain * cost[rows])
        accepted = rows[better]
        x[accepted], cost[accepted] = trial[better], trial_cost[better]
        A[better], b[better] = trial_A[better], trial_b[better]
        mu[rows] = np.maximum(mu[rows] * np.where(better, TRUST, DISTRUST), min_mu)
        active = ~finished & (mu[rows] < MAX_MU) & (cost[rows] > EXACT_COST)
        rows, A, b = rows[active], A[active], b[active]
        if not len(rows):
            break
    return x, cost


def _chosen(better: NDArray[np.bool_], new: T, old: T) -> T:
    """The rows of ``new`` where ``better``, elsewhere those of ``old``; for arrays and
    tuples of them.
    """
    if better.all():
        return new
    if not better.any():
        return old
    if isinstance(new, tuple):
        return type(new)(*(_chosen(better, n, o) for n, o in zip(new, old)))
    return np.where(better.reshape(-1, *[1] * (new.ndim - 1)), new, old)


class Starts(NamedTuple):
    """K starts of each of N frames."""

    x: Array  # (K, N, V)
    expected: Array  # (K, N, V) the predictions about which their priors are
    cost_factor: Array  # (K, N) of the costs that are compared


class SearchResult(NamedTuple):
    """The best fit of each of N frames."""

    x: Array  # (N, V)
    parts: Array  # (N, 4) of its cost: surface, outline, front, prior
    start: NDArray[np.int_]  # (N,) index of its start


class Search:
    """A search with some settings."""

    def __init__(self, settings: SearchSettings) -> None:
        self.settings = settings

    def descend(
        self,
        objective: Objective,
        x: Array,
        seen: Observation,
        prior: Prior,
        stages: Sequence[Stage],
    ) -> tuple[Array, Cost]:
        """Minimise the objective from x (N, V); returns x after all stages, and its cost."""
        factor = self.settings.step_factor
        momentum = self.settings.momentum
        lower, upper = objective.model.lower, objective.model.upper
        x, mu = np.clip(rounded(x, FIT_STEP), lower, upper), np.full(len(x), FIRST_MU)
        measured = objective.measure(x, seen, prior)
        moved = np.zeros_like(x)
        for stage in stages:
            now = objective.weigh(measured, seen, stage.robust)
            active = np.ones(len(x), bool)
            for _ in range(stage.iterations):
                M, b = objective.equations(measured, now)
                step = damped_step(M, b, mu, x, lower, upper, DESCENT_RIDGE)
                trial = np.clip(
                    rounded(x + factor * step + momentum * moved, FIT_STEP), lower, upper
                )
                trial_measured = objective.measure(trial, seen, prior)
                found = objective.weigh(trial_measured, seen, stage.robust)
                better = active & (found.total < now.total)
                active &= ~better | (now.total - found.total >= (stage.min_gain or 0) * now.total)
                moved = np.where(better[:, None], trial - x, 0)
                x = _chosen(better, trial, x)
                measured, now = (
                    _chosen(better, trial_measured, measured),
                    _chosen(better, found, now),
                )
                mu = np.clip(mu * np.where(better, TRUST, DISTRUST), LOW_MU, HIGH_MU)
                if not active.any():
                    break
        return x, now

    def best(
        self, objective: Objective, seen: Observation, starts: Starts, precision: Array, plan: Plan
    ) -> SearchResult:
        """The best start of each frame, with this precision (L, L) of the limbs."""
        K, N, _ = starts.x.shape
        every = np.tile(np.arange(N), K)
        x = starts.x.reshape(K * N, -1)
        own = objective.prior_of(starts.expected.reshape(K * N, -1), precision)
        chosen = np.arange(K * N)
        if plan.trials is not None and K > 1:
            few = seen.thinned(plan.trials.thin).take(every)
            x, cost = self.descend(objective, x, few, own, [plan.trials.stage])
            order = (starts.cost_factor * data_cost(cost.parts).reshape(K, N)).argsort(axis=0)
            chosen = (order[: plan.trials.keep] * N + np.arange(N)).reshape(-1)
        last = Stage(self.settings.robust, plan.iterations, plan.min_gain)
        own = Prior(own.x[chosen], own.rigid[chosen], own.curvature)
        x, cost = self.descend(objective, x[chosen], seen.take(every[chosen]), own, [last])
        compared = starts.cost_factor.reshape(-1)[chosen] * data_cost(cost.parts)
        best = compared.reshape(-1, N).argmin(axis=0) * N + np.arange(N)
        return SearchResult(x[best], cost.parts[best], chosen[best] // N)

    def refining(self, plan: Plan) -> Plan:
        """The plan from one start that is already close to the solution."""
        s = self.settings
        return Plan(plan.name, plan.points, s.refining_iterations, min_gain=s.min_gain)


def data_cost(parts: Array) -> Array:
    """The cost (N,) without the prior, by which starts are compared."""
    return parts[:, :3].sum(axis=1)


def drawn(model: CapsuleModel, x: Array, covariance: Array, count: int, seed: int) -> Array:
    """Draws (count, N, V) about x (N, V), with the limbs' errors of the network,
    within the limits.
    """
    rng = np.random.default_rng(seed)
    starts = np.tile(x, (count, 1, 1))
    errors = rng.multivariate_normal(
        np.zeros(len(model.limbs)), covariance, (count, 1), method="cholesky"
    )
    starts[:, :, model.limbs] += errors
    return np.clip(starts, model.lower, model.upper)


def turned_back(model: CapsuleModel, x: Array, quarter: int) -> Array:
    """Variables (N, V) found in crops turned counter-clockwise by quarter turns, for the
    unturned crops.

    Bodies turn as a whole about the line of sight. Raises NetlibError for a root that
    ``RootMotion`` does not accept.
    """
    if quarter % 4 == 0:
        return x
    root = model.root_motion
    back = x.copy()
    turn = rotation(2, np.array(-quarter * np.pi / 2))
    back[:, root.columns] = root.variables(root.place(x) @ turn.T, turn @ root.rotation(x))
    return back
