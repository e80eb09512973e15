"""handpose/fit/search.py"""

from __future__ import annotations

import numpy as np
import pytest

from handpose.fit.body import CapsuleModel
from handpose.fit.objective import Objective, Weights
from handpose.fit.search import ACCURATE, PLANS, data_cost, drawn, search, turned_back
from layers.hand.bodies import kinematics_of
from tests.handpose.fit.conftest import Scene


@pytest.mark.parametrize("quarter", [0, 1, 2, 3])
def test_a_pose_turned_with_its_picture(model: CapsuleModel, quarter: int) -> None:
    """A pose found in a picture turned counter-clockwise is turned back, with angles of at most half a turn."""
    rng = np.random.default_rng(0)
    inputs = np.where(model.skeleton.fixed, 0, rng.normal(0, 0.3, (4, 47)))
    inputs = model.inputs_of(model.variables_of(inputs))  # within the limits
    joints = kinematics_of(model.skeleton).joints(inputs)
    found = model.inputs_of(turned_back(model, model.variables_of(inputs), quarter))
    angle = -quarter * np.pi / 2
    c, s = np.cos(angle), np.sin(angle)
    expected = joints @ np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]).T
    np.testing.assert_allclose(kinematics_of(model.skeleton).joints(found), expected, atol=1e-9)
    assert (np.abs(found[:, 3:6]) <= np.pi + 1e-9).all()


@pytest.mark.parametrize("name", PLANS)
def test_a_plan_from_near(name: str) -> None:
    """The refining plan has one start, no tournament, no more iterations, all points and the final robustness."""
    plan = PLANS[name]
    near = plan.refining()
    assert (near.draws, near.first, near.keep, near.points) == (0, (), 1, plan.points)
    (stage,) = near.last
    assert stage.robust == plan.last[-1].robust
    assert stage.iterations <= sum(own.iterations for own in (*plan.first, *plan.last))


def test_drawn_starts(model: CapsuleModel, scene: Scene) -> None:
    """Only limbs vary, with the given covariance, within the limits, equally for the same seed and for every frame."""
    L = len(model.limbs)
    spread = np.linspace(0.01, 0.1, L)
    starts = drawn(model, np.zeros((2, model.variables)), np.diag(spread**2), 500, 0)
    others = np.setdiff1d(np.arange(model.variables), model.limbs)
    assert (starts[:, :, others] == 0).all()
    inner = (model.lower[model.limbs] < -0.3) & (model.upper[model.limbs] > 0.3)
    np.testing.assert_allclose(starts[:, 0, model.limbs].std(axis=0)[inner], spread[inner], rtol=0.15)
    assert (starts >= model.lower).all() and (starts <= model.upper).all()
    np.testing.assert_array_equal(starts, drawn(model, np.zeros((2, model.variables)), np.diag(spread**2), 500, 0))
    np.testing.assert_array_equal(starts[:, 0], starts[:, 1])


def test_the_best_explained_start_wins(model: CapsuleModel, scene: Scene) -> None:
    """Of the truth and two poses far from it, the truth wins in most frames and has a much lower cost."""
    objective = Objective(model, Weights())
    wrong = scene.truth.copy()
    wrong[:, 5] += 2.0  # the palm turned in the picture
    also = scene.truth.copy()
    also[:, model.limbs] = model.lower[model.limbs]
    starts = np.stack([wrong, scene.truth, also])
    precision = np.eye(len(model.limbs)) * 20
    found = search(objective, scene.seen, starts, starts, precision, ACCURATE)
    assert (found.start == 1).mean() > 0.7
    alone = search(objective, scene.seen, starts[:1], starts[:1], precision, ACCURATE)
    assert data_cost(found.parts).mean() < 0.6 * data_cost(alone.parts).mean() and (alone.start == 0).all()
