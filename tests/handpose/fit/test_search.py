"""handpose/fit/search.py"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from handpose.fit.body import CapsuleModel
from handpose.fit.objective import Objective, Prior
from handpose.fit.search import Search, Starts, damped_step, drawn, turned_back
from handpose.fit.settings import SearchSettings, Stage, Trials, Weights
from layers.hand.bodies import kinematics_of
from tests.handpose.fit.conftest import Scene, start_of

SEARCH = Search(SearchSettings())
RNG = np.random.default_rng(0)
J, X = RNG.standard_normal((4, 9, 5)), RNG.standard_normal((4, 5))
A, B = J.swapaxes(1, 2) @ J, RNG.standard_normal((4, 5))
B[:, 2] = 1, -1, 1, -1
WIDE = np.full(5, -100.0), np.full(5, 100.0)


def step(
    mu: float, x: np.ndarray = X, limits: tuple[np.ndarray, np.ndarray] = WIDE, ridge: float = 0
) -> np.ndarray:
    return damped_step(A.copy(), B, np.full(4, mu), x, *limits, ridge)


def test_without_damping() -> None:
    """Without damping the step leads to the minimum of the quadratic model."""
    assert_allclose(np.einsum("nij,nj->ni", A, step(0)), -B, atol=1e-10)


def test_much_damping() -> None:
    """Much damping gives a short step downhill, with each variable scaled by its own curvature."""
    assert_allclose(step(1e9) * 1e9, -B / A[:, range(5), range(5)], rtol=1e-6)


@pytest.mark.parametrize("side", [0, 1])
def test_at_a_limit(side: int) -> None:
    """A variable at a limit that would leave it stays, and the others take the step of the
    problem without it.
    """
    limits = np.full(5, -100.0), np.full(5, 100.0)
    limits[side][2] = 0.3
    x = X.copy()
    x[:, 2] = 0.3
    leaves = B[:, 2] > 0 if side == 0 else B[:, 2] < 0
    found = step(0, x, limits)
    others = [0, 1, 3, 4]
    assert_array_equal(found[leaves, 2], 0)
    assert_allclose(found[~leaves], step(0)[~leaves], atol=1e-12)
    for n in np.flatnonzero(leaves):
        a = A[n][np.ix_(others, others)]
        assert_allclose(a @ found[n, others], -B[n, others], atol=1e-10)


def test_a_variable_without_influence_stays() -> None:
    """The ridge makes the matrix invertible."""
    still, gradient = A.copy(), B.copy()
    still[:, 1] = still[:, :, 1] = gradient[:, 1] = 0
    assert_array_equal(damped_step(still, gradient, np.zeros(4), X, *WIDE, 1e-9)[:, 1], 0)


def prior_of(objective: Objective, x: np.ndarray) -> Prior:
    """The prior of a network whose angles have a standard error of 0.15 radians."""
    return objective.prior_of(x, np.eye(len(objective.model.limbs)) / 0.15**2)


def test_the_cost_never_rises_within_a_stage(model: CapsuleModel, scene: Scene) -> None:
    """More iterations in the last stage never give a higher cost, which is that of the result,
    within the limits.
    """
    objective, x = Objective(model, Weights()), start_of(scene, model)
    prior = prior_of(objective, x)
    costs = []
    for iterations in (0, 2, 5, 9):
        found, cost = SEARCH.descend(
            objective, x, scene.seen, prior, (Stage(60, 1), Stage(30, iterations))
        )
        costs.append(cost.total)
        assert (found >= model.lower).all() and (found <= model.upper).all()
        again = objective.weigh(objective.measure(found, scene.seen, prior), scene.seen, 30.0)
        assert_allclose(again.total, cost.total, rtol=1e-4)
    assert (np.diff(costs, axis=0) <= 1e-6 * np.array(costs[:-1])).all()


@pytest.mark.parametrize(
    "trials", [None, Trials(1, 0, 1, Stage(13, 0), 1)], ids=["at the end", "after the first stage"]
)
def test_starts_are_compared_without_the_prior(
    model: CapsuleModel, few: Scene, trials: Trials | None
) -> None:
    """The start that explains the image wins, although the network predicts the other one."""
    objective = Objective(model, Weights())
    wrong, right = (start_of(few, model), few.truth)
    precision = np.eye(len(model.limbs)) / 0.01**2
    plan = replace(SEARCH.settings.fast, iterations=0, trials=trials)
    expected = np.stack([wrong, wrong])
    starts = Starts(np.stack([wrong, right]), expected, np.ones(expected.shape[:2]))
    found = SEARCH.best(objective, few.seen, starts, precision, plan)
    assert_array_equal(found.start, 1)
    assert_allclose(found.x, right, atol=1e-4)
    assert (found.parts[:, 3] > found.parts[:, :3].sum(axis=1)).all()


@pytest.mark.parametrize("quarter", [0, 1, 2, 3])
def test_a_pose_turned_with_its_picture(
    model: CapsuleModel, quarter: int, rng: np.random.Generator
) -> None:
    """A pose found in a picture turned counter-clockwise is turned back, with angles of at
    most half a turn.
    """
    inputs = np.where(model.skeleton.fixed, 0, rng.normal(0, 0.3, (4, 47)))
    inputs = model.inputs_of(model.variables_of(inputs))  # within the limits
    joints = kinematics_of(model.skeleton).joints(inputs)
    found = model.inputs_of(turned_back(model, model.variables_of(inputs), quarter))
    angle = -quarter * np.pi / 2
    c, s = np.cos(angle), np.sin(angle)
    expected = joints @ np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]).T
    assert_allclose(kinematics_of(model.skeleton).joints(found), expected, atol=1e-9)
    assert (np.abs(found[:, 3:6]) <= np.pi + 1e-9).all()


def test_drawn_starts(model: CapsuleModel) -> None:
    """Only limbs vary, with the given covariance, within the limits, equally for the same seed and
    for every frame.
    """
    x, spread = np.zeros((2, model.variables)), np.linspace(0.01, 0.1, len(model.limbs))
    starts = drawn(model, x, np.diag(spread**2), 500, 0)
    others = np.setdiff1d(np.arange(model.variables), model.limbs)
    assert (starts[:, :, others] == 0).all()
    inner = (model.lower[model.limbs] < -0.3) & (model.upper[model.limbs] > 0.3)
    assert_allclose(starts[:, 0, model.limbs].std(axis=0)[inner], spread[inner], rtol=0.15)
    assert (starts >= model.lower).all() and (starts <= model.upper).all()
    assert_array_equal(starts, drawn(model, x, np.diag(spread**2), 500, 0))
    assert_array_equal(starts[:, 0], starts[:, 1])
