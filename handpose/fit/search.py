"""Search among several starts: a few iterations for all on few points, then the best to the end.

A fit converges to the local minimum near its start. A network that confuses two limbs, or the front and back of a body,
starts in the wrong one. Further starts are the network's predictions in the crop turned by quarters, and its prediction
with limbs drawn from the distribution of its errors.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from handpose.fit.body import CapsuleModel
from handpose.fit.levenberg_marquardt import Stage, descend
from handpose.fit.objective import Objective, Prior
from handpose.fit.observation import Observation
from netlib.blob import Array
from netlib.errors import NetlibError


@dataclass(frozen=True)
class Plan:
    """The plan of a search.

    name      of the plan; ``NetworkErrors`` has a table for each
    points    number of points sampled from a frame
    quarters  quarter turns of the crop for the network; 0 is the unchanged crop
    draws     number of further starts, drawn about the first prediction from the network's errors
    first     stages for all starts, on every ``thin``-th point
    keep      number of starts that continue
    last      stages for these, on all points
    """

    name: str
    points: int
    quarters: tuple[int, ...]
    draws: int
    thin: int
    first: tuple[Stage, ...]
    keep: int
    last: tuple[Stage, ...]

    def refining(self) -> Plan:
        """The plan from one start that is already close to the solution."""
        return replace(self, draws=0, first=(), keep=1, last=(Stage(self.last[-1].robust, REFINING, MIN_GAIN),))


REFINING, MIN_GAIN = 4, 0.02  # iterations from a start that is close, and when they end earlier: ``Stage``
FAST = Plan("fast", 300, (0,), 0, 1, (), 1, (Stage(13, 6),))
ACCURATE = Plan("accurate", 400, (0, 1, 2, 3), 6, 4, (Stage(15, 5),), 2, (Stage(13, 5),))
PLANS = {plan.name: plan for plan in (FAST, ACCURATE)}
Fit = Literal["no", "fast", "accurate"]  # the name of a plan, or "no" for the network alone


class Found(NamedTuple):
    """The best fit of each of N frames."""

    x: Array  # (N, V)
    parts: Array  # (N, 4) of its cost: surface, outline, front, prior
    start: NDArray[np.int_]  # (N,) index of its start


def search(
    objective: Objective, seen: Observation, priors: Array, starts: Array, precision: Array, plan: Plan,
    cost_factor: Array | float = 1.0,
) -> Found:
    """The best of K starts (K, N, V); each has a prior about the prediction ``priors`` (K, N, V).

    cost_factor  (K, N) factors of the costs that are compared
    """
    K, N, _ = starts.shape
    every, cost_factors = np.tile(np.arange(N), K), np.broadcast_to(cost_factor, (K, N))
    x, own = starts.reshape(K * N, -1), objective.prior_of(priors.reshape(K * N, -1), precision)
    chosen = np.arange(K * N)
    if plan.first and K > 1:
        x, cost = descend(objective, x, seen.thinned(plan.thin).take(every), own, plan.first)
        order = (cost_factors * data_cost(cost.parts).reshape(K, N)).argsort(axis=0)[: plan.keep]
        chosen = (order * N + np.arange(N)).reshape(-1)
    own = Prior(own.x[chosen], own.rigid[chosen], own.curvature)
    x, cost = descend(objective, x[chosen], seen.take(every[chosen]), own, plan.last)
    compared = cost_factors.reshape(-1)[chosen] * data_cost(cost.parts)
    best = compared.reshape(-1, N).argmin(axis=0) * N + np.arange(N)
    return Found(x[best], cost.parts[best], chosen[best] // N)


def data_cost(parts: Array) -> Array:
    """The cost (N,) without the prior, by which starts are compared."""
    return np.asarray(parts[:, :3].sum(axis=1))


def drawn(model: CapsuleModel, x: Array, covariance: Array, count: int, seed: int) -> Array:
    """Draws (count, N, V) about x (N, V), with the limbs' errors of the network, within the limits."""
    rng = np.random.default_rng(seed)
    starts = np.tile(x, (count, 1, 1))
    errors = rng.multivariate_normal(np.zeros(len(model.limbs)), covariance, (count, 1), method="cholesky")
    starts[:, :, model.limbs] += errors
    return np.clip(starts, model.lower, model.upper)


def turned_back(model: CapsuleModel, x: Array, quarter: int) -> Array:
    """Variables (N, V) found in crops turned counter-clockwise by quarter turns, for the unturned crops.

    A rotation about the line of sight rotates the root's position and is added to its outermost angle. Raises
    NetlibError for a skeleton whose root does not translate along x and y and turn about z first.
    """
    if quarter % 4 == 0:
        return x
    skeleton = model.skeleton
    motions = skeleton.motions[int(np.flatnonzero(skeleton.parents < 0)[0])]
    slides = {m.axis: m for m in motions if m.kind == "translate"}
    turns = [m for m in motions if m.kind == "rotate"]
    if not {0, 1} <= set(slides) or not turns or turns[0].axis != 2:
        raise NetlibError(
            f"skeleton {skeleton.name!r}: its root does not translate along x and y and turn about z first, so it "
            "cannot be turned with the picture; expected a plan without quarter turns"
        )
    column = {int(dof): i for i, dof in enumerate(model.free)}
    right, up = (slides[a].sign * (x[:, column[slides[a].dof]] + skeleton.initial[slides[a].dof]) for a in (0, 1))
    c, s = [(0, -1), (-1, 0), (0, 1)][quarter % 4 - 1]  # cosine and sine of -quarter * 90 degrees
    result = x.copy()
    for axis, value in ((0, c * right - s * up), (1, s * right + c * up)):
        m = slides[axis]
        result[:, column[m.dof]] = m.sign * value - skeleton.initial[m.dof]
    angle = result[:, column[turns[0].dof]] - turns[0].sign * quarter * np.pi / 2
    result[:, column[turns[0].dof]] = (angle + np.pi) % (2 * np.pi) - np.pi
    return result
