"""handpose/fit/levenberg_marquardt.py: descend"""

from __future__ import annotations

import itertools

import numpy as np

from handpose.fit.body import CapsuleModel
from handpose.fit.levenberg_marquardt import Stage, descend
from handpose.fit.objective import Objective, Prior, Weights
from tests.handpose.fit.conftest import Scene

STAGES = (Stage(30, 6), Stage(15, 6), Stage(10, 4))


def start_of(scene: Scene, model: CapsuleModel) -> np.ndarray:
    """The truth with errors of about 0.15 radians in every angle and 15 mm in every direction."""
    off = np.random.default_rng(1).normal(0, 0.15, scene.truth.shape)
    off[:, :3] *= 0.6
    off[:, -2:] = 0
    return np.clip(scene.truth + off, model.lower, model.upper)


def prior_of(objective: Objective, x: np.ndarray) -> Prior:
    """The prior of a network whose angles have a standard error of 0.15 radians."""
    return objective.prior_of(x, np.eye(len(objective.model.limbs)) / 0.15**2)


def error(model: CapsuleModel, x: np.ndarray, scene: Scene) -> np.ndarray:
    """Mean error (N,) in mm."""
    return np.linalg.norm(model.joints(x) - scene.joints, axis=2).mean(axis=1)


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
    from handpose.fit.observation import observe
    from handpose.frames.cameras import NYU

    seen = observe(np.ones((1, 128, 128), np.float32), [[320, 240, 700]], NYU, 300.0)
    objective, x = Objective(model, Weights(outline=0.0)), scene.truth[:1]
    found, _ = descend(objective, x, seen, prior_of(objective, x), STAGES)
    np.testing.assert_allclose(found, x, atol=1e-3)
