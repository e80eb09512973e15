"""handpose/fit/depth_fit.py"""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from handpose.fit.body import SIZE_INDEX, CapsuleModel
from handpose.fit.depth_fit import DepthFitter
from handpose.fit.network_errors import NetworkErrors
from handpose.fit.observation import HandCrops, observe
from handpose.fit.rounding import NETWORK_STEP, rounded
from handpose.fit.settings import FitSettings, Plan, SearchSettings, SteadySettings
from handpose.frames.cameras import NYU
from netlib import engine
from tests.handpose.fit.conftest import Scene, error, start_of

FAST, ACCURATE = SearchSettings().plans.values()


@pytest.fixture(scope="module")
def fitter(model: CapsuleModel) -> DepthFitter:
    """The fitter for a network whose limbs have errors of 0.15 radians."""
    return DepthFitter(model, NetworkErrors(np.eye(20) * 0.15**2))


def test_a_fast_fit(fitter: DepthFitter, scene: Scene) -> None:
    """A fast fit returns joints near the truth, and matching inputs, size and cost."""
    model = fitter.model
    start = start_of(scene, model)
    found = fitter.fit(scene.seen, [start], FAST)
    assert np.median(error(model, found.x, scene)) < 0.5 * np.median(error(model, start, scene))
    assert_allclose(found.joints, model.joints(found.x))
    size = np.exp(found.x[:, SIZE_INDEX])
    assert ((size > 0.65) & (size < 1.36)).all() and (found.start == 0).all()
    assert_allclose(found.cost, found.parts.sum(axis=1))
    assert_allclose(found.network, model.joints(rounded(start, NETWORK_STEP)), atol=1e-6)


def test_more_starts_are_better_explained(fitter: DepthFitter, scene: Scene) -> None:
    """The accurate plan has a lower cost on average."""
    start = start_of(scene, fitter.model)
    fast = fitter.fit(scene.seen, [start], FAST)
    accurate = fitter.fit(scene.seen, [start] * 4, ACCURATE)
    assert np.log(accurate.cost).mean() < np.log(fast.cost).mean()


@pytest.mark.parametrize("plan", [FAST, ACCURATE], ids=lambda plan: plan.name)
def test_the_same_frames_give_the_same_bits(
    fitter: DepthFitter, few: Scene, plan: Plan, rng: np.random.Generator
) -> None:
    """A fit does not depend on other frames, the number of threads, and differences of
    predictions by 1e-7.
    """
    start = start_of(few, fitter.model)
    quarters = len(plan.quarters)
    threads = engine.get().threads()
    whole = fitter.fit(few.seen, [start] * quarters, plan)
    one = fitter.fit(few.seen.take(slice(3, 4)), [start[3:4]] * quarters, plan)
    assert_allclose(one.joints[0], whole.joints[3], atol=1e-6)
    nearly = start + rng.normal(0, 1e-7, start.shape) * (start != 0)
    try:
        engine.get().set_threads(1)
        assert_array_equal(fitter.fit(few.seen, [nearly] * quarters, plan).x, whole.x)
    finally:
        engine.get().set_threads(threads)


def test_weights_keep_a_fit_away_from_other_surfaces(fitter: DepthFitter, few: Scene) -> None:
    """A board 20 mm behind the palm; the parts of the cost count its points as the hand's."""
    model, start = fitter.model, start_of(few, fitter.model)
    behind = few.joints.mean(axis=1)[:, 2, None, None] / 150 + 20 / 150
    crops = np.minimum(few.crops, behind).astype(np.float32)
    weight = np.where(few.crops < crops + 1e-6, 1.0, 0.05).astype(np.float32)
    plain, weighted = (
        observe(HandCrops(crops, few.center_uvd, NYU, 300.0, weight=weights), 400, 3.0)
        for weights in (None, weight)
    )
    found, better = (fitter.fit(seen, [start], FAST) for seen in (plain, weighted))
    assert np.median(error(model, better.x, few)) < 0.8 * np.median(error(model, found.x, few))
    robust = SearchSettings().robust
    assert_allclose(better.parts[:, 0], fitter.objective.surface_cost(better.x, plain, robust))
    assert (better.cost < better.parts.sum(axis=1)).all()


def test_an_empty_crop_and_a_speck_have_an_infinite_cost(fitter: DepthFitter, scene: Scene) -> None:
    crops = np.ones((2, 128, 128), np.float32)
    crops[1, 60:70, 60:70] = 0
    found = fitter.fit(
        observe(HandCrops(crops, scene.center_uvd[:2], NYU, 300.0), 400, 3.0),
        [scene.truth[:2]],
        FAST,
    )
    assert np.isinf(found.parts).all() and np.isinf(found.cost).all()


def test_the_wrong_hand_explains_less(fitter: DepthFitter, scene: Scene) -> None:
    """From the true pose, every right hand costs less as a right hand than as its mirror image."""
    right = fitter.fit(scene.seen, [scene.truth] * 4, ACCURATE)
    uvd = scene.center_uvd * (-1, 1, 1) + (NYU.width - 1, 0, 0)
    in_mirror = observe(HandCrops(scene.crops[:, :, ::-1], uvd, NYU.mirrored(), 300.0), 400, 3.0)
    left = fitter.fit(in_mirror, [scene.truth] * 4, ACCURATE)
    assert (right.cost < left.cost).all()


def test_the_pose_of_the_previous_frame_is_one_more_start(
    fitter: DepthFitter, scene: Scene, rng: np.random.Generator
) -> None:
    """It wins if the network is far off, and loses if it is far off itself."""
    model = fitter.model
    far = scene.truth.copy()
    limbs = model.limbs
    far[:, limbs] = np.clip(far[:, limbs] + 0.9, model.lower[limbs], model.upper[limbs])
    far[:, model.root[3:]] += 0.7
    near = scene.truth + rng.normal(0, 0.02, scene.truth.shape)
    alone = fitter.fit(scene.seen, [far], FAST)
    found = fitter.fit(scene.seen, [far], FAST, before=near)
    assert (found.start == 1).mean() > 0.7 and np.median(error(model, found.x, scene)) < 4
    assert error(model, found.x, scene).mean() < 0.5 * error(model, alone.x, scene).mean()
    assert_allclose(found.network, alone.network)
    other = fitter.fit(scene.seen, [near], FAST, before=far)
    assert (other.start == 0).mean() > 0.7
    accurate = fitter.fit(scene.seen, [far] * 4, ACCURATE, before=near)
    assert (accurate.start == 4).mean() > 0.5


def test_a_frame_without_a_previous_one_is_fitted_alone(fitter: DepthFitter, few: Scene) -> None:
    """A frame with NaN as its previous frame is fitted as if it had none; the other frames
    are not affected.
    """
    starts = [
        few.truth + np.random.default_rng(q).normal(0, 0.1, few.truth.shape)
        for q in ACCURATE.quarters
    ]
    before = few.truth.copy()
    before[::2] = np.nan
    found = fitter.fit(few.seen, starts, ACCURATE, before=before)
    alone = fitter.fit(few.seen, starts, ACCURATE)
    followed = fitter.fit(few.seen, starts, ACCURATE, before=few.truth)
    assert_array_equal(found.x[::2], alone.x[::2])
    assert_array_equal(found.x[1::2], followed.x[1::2])


def test_known_sizes_are_kept(fitter: DepthFitter, scene: Scene) -> None:
    """All frames have a known size, or each its own, which also holds for the start from the
    previous frame.
    """
    sizes = np.linspace(0.9, 1.1, len(scene.truth))
    for found, size in (
        (fitter.fit(scene.seen, [scene.truth], FAST, size=1.07), 1.07),
        (fitter.fit(scene.seen, [scene.truth], FAST, size=sizes, before=scene.truth), sizes),
        (fitter.follow(scene.seen, scene.truth, FAST, size=sizes), sizes),
    ):
        assert_allclose(np.exp(found.x[:, SIZE_INDEX]), size, atol=3e-3)


@pytest.mark.parametrize("plan", [FAST, ACCURATE], ids=lambda plan: plan.name)
def test_following_reduces_the_error_without_a_network(
    fitter: DepthFitter, scene: Scene, plan: Plan, rng: np.random.Generator
) -> None:
    model = fitter.model
    before = scene.truth + rng.normal(0, 0.05, scene.truth.shape)
    before[:, -2:] = 0
    kept = before.copy()
    found = fitter.follow(scene.seen, before, plan)
    assert error(model, found.x, scene).mean() < error(model, before, scene).mean()
    assert_array_equal(before, kept)


def test_followed_limbs_are_held(
    fitter: DepthFitter, scene: Scene, rng: np.random.Generator
) -> None:
    """Limbs stay nearer to the expected pose than the network's errors imply; the cost uses the
    network's errors.
    """
    model, objective = fitter.model, fitter.objective
    before = scene.truth + rng.normal(0, 0.1, scene.truth.shape)
    before[:, -2:] = 0
    before = np.clip(before, model.lower, model.upper)
    found = fitter.follow(scene.seen, before, FAST)
    expected = before.copy()
    expected[:, model.own] = 0
    prior = objective.measure(
        found.x, scene.seen, objective.prior_of(expected, fitter.precision)
    ).prior
    assert_allclose(found.parts[:, 3], prior, rtol=1e-4)
    settings = FitSettings(steady=SteadySettings(limb_precision=1.0))
    loose = DepthFitter(model, fitter.errors, settings=settings).follow(scene.seen, before, FAST)
    held, free = (np.abs(fit.x - before)[:, model.limbs].mean() for fit in (found, loose))
    assert held < 0.95 * free
