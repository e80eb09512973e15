"""handpose/tracking/sizing.py: hands of a known size, fitted with another size"""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from handpose.body.render import normalise_depth, render_crop
from handpose.body.sides import Side
from handpose.estimate.hand import Hand
from handpose.fit.body import MAX_SIZE, MIN_SIZE, SIZE, TYPICAL_SIZE, CapsuleModel
from handpose.fit.depth_fit import DepthFitter
from handpose.fit.observation import Observation, observe
from handpose.frames.cameras import NYU
from handpose.synthetic import prior_file
from handpose.synthetic.generator import Generator, Recipe, View
from handpose.synthetic.recipes import recipe
from handpose.tracking import sizing
from handpose.tracking.sizing import NEAR, POPULATION, SizeKeeper, lowest, size_of

TRUE, COUNT = 0.93, 60


@pytest.fixture(scope="module")
def estimator(model: CapsuleModel) -> Any:
    """The used attributes of an estimator."""
    return SimpleNamespace(fitter=DepthFitter(model), camera=NYU, cube_mm=300.0)


@pytest.fixture(scope="module")
def hands(model: CapsuleModel) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Crops (N, 128, 128) of right hands of the true size, centres (N, 3), and variables (N, V) with small errors."""
    exact = prior_file.load().but(scale_std=0, bone_std=0)
    drawn = Generator(5, "train", Recipe(prior=exact, views=(View(NYU, None),))).scene(0)
    x, uvd = model.variables_of(drawn.bodies.inputs[:COUNT]), drawn.center_uvd[:COUNT]
    x[:, SIZE] = np.log(TRUE)
    depth = render_crop(model.capsules(x, NYU.unproject(uvd)), uvd, 300.0)
    fitted = x + np.random.default_rng(0).normal(0, 0.03, x.shape)
    fitted[:, SIZE] = np.random.default_rng(1).normal(0, 0.05, len(x))  # about 1 instead of the true size
    return normalise_depth(depth, uvd[:, 2], 300.0), uvd, fitted


def estimates(
    model: CapsuleModel, hands: tuple[np.ndarray, np.ndarray, np.ndarray], side: Side, confidence: float = 1.0
) -> list[Hand]:
    """Estimates of these hands, or of their mirror images."""
    found = []
    for crop, uvd, x in zip(*hands):
        if side == "left":
            crop, uvd = crop[:, ::-1], np.array([2 * NYU.u0 - uvd[0], *uvd[1:]])
        fit: Any = SimpleNamespace(x=x[None], uncertainty=np.ones(1))
        found.append(Hand(side, crop, uvd, 300.0, NYU, np.zeros((31, 3)), fit, model, error_mm=1.0,
                          confidence=confidence))
    return found


# ---------------------------------------------------------------------------------------------- of some frames


def drawn(
    model: CapsuleModel, hands: tuple[np.ndarray, np.ndarray, np.ndarray], size: float
) -> tuple[Observation, np.ndarray]:
    """Six of the hands with this size, and fits of them with another one."""
    _, uvd, x = (values[:6] for values in hands)
    truth = x.copy()
    truth[:, SIZE] = np.log(size)
    depth = render_crop(model.capsules(truth, NYU.unproject(uvd)), uvd, 300.0)
    return observe(normalise_depth(depth, uvd[:, 2], 300.0), uvd, NYU, 300.0, 200), x


@pytest.mark.parametrize("size", [0.92, 0.761, 1.329])
def test_the_size_in_some_frames(model: CapsuleModel, hands: Any, size: float) -> None:
    sizes = np.geomspace(MIN_SIZE, MAX_SIZE, 25)
    assert size_of(DepthFitter(model), *drawn(model, hands, size), sizes) == pytest.approx(size, abs=0.012)


def test_sizes_that_are_tried(model: CapsuleModel, hands: Any) -> None:
    """One outside their range is not found; the prior pulls to the typical one."""
    near, fitter, seen = np.exp(NEAR), DepthFitter(model), drawn(model, hands, 0.955)
    alone = size_of(fitter, *seen, near)
    assert alone == pytest.approx(0.955, abs=0.015)
    assert size_of(fitter, *seen, 1.05 * near[-3:] / near[-3]) <= 1.05
    assert TYPICAL_SIZE < size_of(fitter, *seen, near, deviation=0.01) < alone


def test_the_least_of_few_costs() -> None:
    """The minimum is that of a parabola, or the first or last size if the costs decrease towards it."""
    sizes = np.exp([-0.1, 0.0, 0.1])
    assert lowest(sizes, np.array([2.0, 1.0, 2.0])) == pytest.approx(1.0)
    assert lowest(sizes, np.array([1.0, 1.0, 2.0])) == pytest.approx(np.exp(-0.05))
    assert lowest(sizes, np.array([1.0, 3.0, 4.0])) == pytest.approx(sizes[0])
    assert lowest(sizes, np.array([4.0, 3.0, 1.0])) == pytest.approx(sizes[2])


# ---------------------------------------------------------------------------------------------- in a track


@pytest.mark.parametrize("side", ["right", "left"])
def test_the_size_of_a_hand(model: CapsuleModel, estimator: Any, hands: Any, side: Side) -> None:
    """The size is returned once, after more than five frames."""
    keeper, reported = SizeKeeper(estimator), []
    for n, estimate in enumerate(estimates(model, hands, side)):
        reported.append(keeper.take(estimate, n / 5))
        if reported[-1] is not None:
            break
    assert len(reported) > 5 and reported[:-1] == [None] * (len(reported) - 1)
    assert reported[-1] == pytest.approx(TRUE, abs=0.02)


def test_the_population_is_that_of_the_training_frames() -> None:
    """The recipe of the packaged weights samples sizes with this deviation."""
    prior = recipe("people").prior
    assert prior.scale_std / prior.scale_mean == pytest.approx(POPULATION, abs=0.001)


@pytest.fixture
def fewer(monkeypatch: pytest.MonkeyPatch) -> None:
    """The size is estimated from half as many poses, in less time."""
    monkeypatch.setattr(sizing, "BEST", sizing.BEST // 2)


@pytest.mark.usefixtures("fewer")
def test_a_size_far_from_what_was_expected(model: CapsuleModel, estimator: Any, hands: Any) -> None:
    """The true size is found although the hands were fitted with one a fifth smaller."""
    crops, uvd, x = hands
    wrong = x.copy()
    wrong[:, SIZE] = np.log(0.8)
    keeper, reported = SizeKeeper(estimator), []
    for n, estimate in enumerate(estimates(model, (crops, uvd, wrong), "right")):
        reported.append(keeper.take(estimate, n / 5))
    assert [one for one in reported if one] == [pytest.approx(TRUE, abs=0.03)]


@pytest.mark.usefixtures("fewer")
def test_sights_as_the_other_hand_say_nothing(model: CapsuleModel, estimator: Any, hands: Any) -> None:
    """After the side has changed, earlier estimates of the other side are ignored."""
    keeper, reported = SizeKeeper(estimator), []
    for n, estimate in enumerate([*estimates(model, hands, "left")[:20], *estimates(model, hands, "right")]):
        reported.append(keeper.take(estimate, n / 5))
        if reported[-1] is not None:
            break
    assert reported[-1] == pytest.approx(TRUE, abs=0.02)


def test_frames_that_say_nothing(model: CapsuleModel, estimator: Any, hands: Any) -> None:
    """Estimates that are uncertain, or follow one another too soon, are ignored."""
    keeper = SizeKeeper(estimator)
    doubtful = estimates(model, hands, "right", 0.3)
    assert [keeper.take(estimate, n / 5) for n, estimate in enumerate(doubtful)] == [None] * COUNT
    soon = estimates(model, hands, "right")
    assert [keeper.take(estimate, 10 + n / 1000) for n, estimate in enumerate(soon)] == [None] * COUNT
