"""handpose/fit/levenberg_marquardt.py"""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from handpose.fit.body import CapsuleModel
from handpose.fit.levenberg_marquardt import Stage, damped_step, descend
from handpose.fit.objective import Objective, Prior, Weights
from handpose.fit.observation import observe
from handpose.frames.cameras import NYU
from tests.handpose.fit.conftest import Scene, error, start_of

RNG = np.random.default_rng(0)
J, X = RNG.standard_normal((4, 9, 5)), RNG.standard_normal((4, 5))
A, B = J.swapaxes(1, 2) @ J, RNG.standard_normal((4, 5))
B[:, 2] = 1, -1, 1, -1
WIDE = np.full(5, -100.0), np.full(5, 100.0)


def step(mu: float, x: np.ndarray = X, limits: tuple[np.ndarray, np.ndarray] = WIDE, ridge: float = 0) -> np.ndarray:
    return damped_step(A.copy(), B, np.full(4, mu), x, *limits, ridge)


def test_without_damping() -> None:
    """Without damping the step leads to the minimum of the quadratic model."""
    np.testing.assert_allclose(np.einsum("nij,nj->ni", A, step(0)), -B, atol=1e-10)


def test_much_damping() -> None:
    """Much damping gives a short step downhill, with each variable scaled by its own curvature."""
    np.testing.assert_allclose(step(1e9) * 1e9, -B / A[:, range(5), range(5)], rtol=1e-6)


@pytest.mark.parametrize("side", [0, 1])
def test_at_a_limit(side: int) -> None:
    """A variable at a limit that would leave it stays, and the others take the step of the problem without it."""
    limits = np.full(5, -100.0), np.full(5, 100.0)
    limits[side][2] = 0.3
    x = X.copy()
    x[:, 2] = 0.3
    leaves = B[:, 2] > 0 if side == 0 else B[:, 2] < 0
    found, others = step(0, x, limits), [0, 1, 3, 4]
    np.testing.assert_array_equal(found[leaves, 2], 0)
    np.testing.assert_allclose(found[~leaves], step(0)[~leaves], atol=1e-12)
    for n in np.flatnonzero(leaves):
        np.testing.assert_allclose(A[n][np.ix_(others, others)] @ found[n, others], -B[n, others], atol=1e-10)


def test_nothing_depends_on_a_variable() -> None:
    """A variable without influence stays, because the ridge makes the matrix invertible."""
    still, gradient = A.copy(), B.copy()
    still[:, 1] = still[:, :, 1] = gradient[:, 1] = 0
    np.testing.assert_array_equal(damped_step(still, gradient, np.zeros(4), X, *WIDE, 1e-9)[:, 1], 0)


STAGES = (Stage(30, 6), Stage(15, 6), Stage(10, 4))


def prior_of(objective: Objective, x: np.ndarray) -> Prior:
    """The prior of a network whose angles have a standard error of 0.15 radians."""
    return objective.prior_of(x, np.eye(len(objective.model.limbs)) / 0.15**2)


def test_it_comes_near_the_truth(model: CapsuleModel, scene: Scene) -> None:
    """The error falls from more than 12 mm to less than 5 mm, and no frame gets more than 3 mm worse."""
    objective, x = Objective(model, Weights()), start_of(scene, model)
    found, cost = descend(objective, x, scene.seen, prior_of(objective, x), STAGES)
    before, after = error(model, x, scene), error(model, found, scene)
    assert before.mean() > 12 and np.median(after) < 5 and (after < before + 3).all()
    assert (found >= model.lower).all() and (found <= model.upper).all()
    again = objective.weigh(objective.measure(found, scene.seen, prior_of(objective, x)), scene.seen, 10.0)
    np.testing.assert_allclose(again.total, cost.total, rtol=1e-4)


def test_the_cost_never_rises_within_a_stage(model: CapsuleModel, scene: Scene) -> None:
    """More iterations within a stage never give a higher cost."""
    objective, x = Objective(model, Weights()), start_of(scene, model)
    costs = [descend(objective, x, scene.seen, prior_of(objective, x), (Stage(30, n),))[1].total for n in (0, 2, 5, 9)]
    for earlier, later in itertools.pairwise(costs):
        assert (later <= earlier + 1e-6 * earlier).all()


def test_frames_do_not_depend_on_each_other(model: CapsuleModel, scene: Scene) -> None:
    """A frame fitted alone, with others, or several times in one batch gives the same result up to rounding."""
    objective, x = Objective(model, Weights()), start_of(scene, model)
    together, _ = descend(objective, x, scene.seen, prior_of(objective, x), STAGES[:1])
    rows = np.array([5, 2, 5])
    some, _ = descend(objective, x[rows], scene.seen.take(rows), prior_of(objective, x[rows]), STAGES[:1])
    np.testing.assert_allclose(some, together[rows], atol=0.01)
    np.testing.assert_array_equal(some[0], some[2])


def test_an_empty_picture_leaves_the_prediction(model: CapsuleModel, scene: Scene) -> None:
    """Without depth readings the result equals the prior's centre."""
    seen = observe(np.ones((1, 128, 128), np.float32), [[320, 240, 700]], NYU, 300.0)
    objective, x = Objective(model, Weights(outline=0.0)), scene.truth[:1]
    found, _ = descend(objective, x, seen, prior_of(objective, x), STAGES)
    np.testing.assert_allclose(found, x, atol=1e-3)
