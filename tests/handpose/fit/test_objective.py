"""handpose/fit/objective.py"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from handpose.fit import objective as objectives
from handpose.fit.body import SIZE_INDEX, CapsuleModel
from handpose.fit.network_errors import Poses
from handpose.fit.objective import Objective, Prior
from handpose.fit.settings import Weights
from tests.handpose.fit.conftest import Scene, slopes

SURFACE, OUTLINE, FRONT, PRIOR = range(4)


def moved(scene: Scene, size: float = 0.05) -> np.ndarray:
    """The truth with small errors in all variables."""
    return scene.truth + np.random.default_rng(0).normal(0, size, scene.truth.shape)


def prior_of(objective: Objective, scene: Scene) -> Prior:
    """The prior about the truth."""
    return objective.prior_of(scene.truth, np.eye(len(objective.model.limbs)) * 11.0)


def cost(
    objective: Objective, x: np.ndarray, scene: Scene, robust: float = 40.0
) -> objectives.Cost:
    """The total cost and its parts at x."""
    prior = prior_of(objective, scene)
    return objective.weigh(objective.measure(x, scene.seen, prior), scene.seen, robust)


def equations(
    objective: Objective, x: np.ndarray, scene: Scene, robust: float = 40.0
) -> tuple[np.ndarray, np.ndarray]:
    """The curvature and half the gradient at x."""
    measured = objective.measure(x, scene.seen, prior_of(objective, scene))
    return objective.equations(measured, objective.weigh(measured, scene.seen, robust))


def test_the_truth_costs_little(model: CapsuleModel, scene: Scene) -> None:
    """Every term costs less at the truth than at some distance from it, and the parts add
    up to the total.
    """
    objective = Objective(model, Weights())
    true, off = cost(objective, scene.truth, scene), cost(objective, moved(scene, 0.15), scene)
    for term in (SURFACE, OUTLINE, FRONT, PRIOR):
        assert true.parts[:, term].mean() < off.parts[:, term].mean()
    assert true.parts[:, PRIOR].max() < 1e-6
    assert_allclose(true.total, true.parts.sum(axis=1))


def test_the_prior_by_hand(model: CapsuleModel, scene: Scene) -> None:
    """The prior equals values worked out by hand, for a limb, the forearm, the
    thickness and the palm.
    """
    weights = Weights(limbs=2.0, size=0.1, thickness=0.2)
    objective = Objective(model, weights)
    x = scene.truth.copy()
    x[0, model.limbs[3]] += 0.1
    x[1, model.own[0]] += 0.1
    x[2, -1] += 0.1
    x[3, model.root[0]] += 0.1  # 15 mm
    found = cost(objective, x, scene).parts[:, PRIOR]
    flexion = model.deviation[model.own[0]]
    n = len(model.rigid)
    assert found[:4] == pytest.approx(
        [2 * 11 * 0.01, 0.01 / flexion**2, 0.01 / 0.04, n * 15**2 / 14**2], rel=1e-3
    )
    known = objective.of_known_size()
    x[4, SIZE_INDEX] += 0.01
    assert cost(known, x, scene).parts[4, PRIOR] > 1000 > cost(objective, x, scene).parts[4, PRIOR]


# hardly anything but the prior
ALONE = Weights(poses=0.5, outline=0.0, front=0.0, independent=1e-9)


def natural_poses(model: CapsuleModel) -> Poses:
    """Poses whose limbs move together."""
    rng, L = np.random.default_rng(1), len(model.limbs)
    return Poses.of(rng.normal(0.3, 0.2, (500, L)) @ rng.normal(0, 0.3, (L, L)))


def test_natural_poses_cost_less(model: CapsuleModel, scene: Scene) -> None:
    """The squared distance from the mean pose, in units of the covariance, adds to the prior and to
    the curvature.
    """
    poses = natural_poses(model)
    plain, natural = Objective(model, ALONE), Objective(model, ALONE, poses)
    x = moved(scene)
    off = x[:, model.limbs] - poses.mean
    expected = 0.5 * (off * np.linalg.solve(poses.covariance, off.T).T).sum(axis=1)
    for one, other in ((natural, plain), (natural.of_known_size(), plain.of_known_size())):
        found = cost(one, x, scene).parts - cost(other, x, scene).parts
        assert_allclose(found[:, PRIOR], expected)
        assert not found[:, :PRIOR].any()
    A, plain_A = (equations(objective, x, scene)[0] for objective in (natural, plain))
    limbs = np.ix_(range(len(x)), model.limbs, model.limbs)
    assert_allclose((A - plain_A)[limbs], np.tile(natural.natural, (len(x), 1, 1)))


def test_a_forearm_counts_less(model: CapsuleModel, scene: Scene) -> None:
    """Points on the skeleton's own capsules count fully, those on a forearm by the
    weight ``beyond``.
    """
    weights = Weights(beyond=0.5)
    whole, less = (Objective(model, w) for w in (Weights(beyond=1.0), weights))
    measured = whole.measure(scene.truth, scene.seen, prior_of(whole, scene))
    P = scene.seen.points.shape[2]
    weight = [one.weigh(measured, scene.seen, 40.0).weight[:, :, :P] for one in (whole, less)]
    arm = model.surface.limbs[measured.residuals.capsule[:, :P]]
    assert 0.01 < arm.mean() < 0.5
    assert_allclose(weight[1], weight[0] * np.where(arm, 0.5, 1.0)[:, None], rtol=1e-6)


@pytest.mark.parametrize("robust", [40.0, 10.0])
def test_the_gradient_of_the_prior_and_of_the_robust_terms(
    model: CapsuleModel, few: Scene, robust: float
) -> None:
    """b is half the gradient: exactly for the prior, and for all terms where no point changes its
    capsule or pixel.
    """
    x = moved(few, 0.02)
    for objective, share in (
        (Objective(model, ALONE), 100),
        (Objective(model, ALONE, natural_poses(model)), 100),
        (Objective(model, Weights(outline=0.0, front=0.0)), 75),
    ):
        _, b = equations(objective, x, few, robust)
        found = slopes(lambda x, objective=objective: cost(objective, x, few, robust).total, x) / 2
        off = np.abs(found - b) / (np.abs(b) + 0.02 * np.abs(b).max(axis=1, keepdims=True))
        assert np.percentile(off, share) < 0.15


def test_each_weight_weighs_its_term(model: CapsuleModel, scene: Scene) -> None:
    """Doubling a weight doubles its part of the cost and leaves the other parts unchanged."""
    x, w = moved(scene, 0.1), Weights()
    base = cost(Objective(model, w), x, scene).parts
    for change, term in (("independent", SURFACE), ("outline", OUTLINE), ("front", FRONT)):
        doubled = cost(
            Objective(model, replace(w, **{change: 2 * getattr(w, change)})), x, scene
        ).parts
        expected = base.copy()
        expected[:, term] *= 2
        assert_allclose(doubled, expected, rtol=1e-4)
