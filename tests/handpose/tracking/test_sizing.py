"""handpose/tracking/sizing.py: hands of a known size, fitted with another size"""

from __future__ import annotations

from collections.abc import Sequence
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from handpose.body.render import normalise_depth, render_crop
from handpose.body.sides import Side, camera_of
from handpose.estimate.hand import HandEstimate
from handpose.fit.body import SIZE_INDEX, TYPICAL_SIZE, CapsuleModel
from handpose.fit.depth_fit import DepthFitter
from handpose.frames.cameras import NYU
from handpose.synthetic.generator import Generator, Recipe, SyntheticCamera
from handpose.synthetic.prior_parameters import RangeParameter
from handpose.synthetic.recipes import recipe
from handpose.tracking import sizing
from handpose.tracking.settings import SizeSettings
from handpose.tracking.sizing import POPULATION, SizeKeeper, lowest
from tests.support.packaged_hand import EXACT

Poses = tuple[np.ndarray, np.ndarray]

SETTINGS = SizeSettings()


@pytest.fixture(scope="module")
def poses(model: CapsuleModel) -> Poses:
    """Variables (N, V) of right hands, and the centres (N, 3) of their crops."""
    # enlarged hands are in front of the camera, too
    away = EXACT.but(depth=RangeParameter(550.0, 1000.0))
    drawn = Generator(5, "train", Recipe(prior=away, views=(SyntheticCamera(NYU, None),))).scene(0)
    return model.variables_of(drawn.bodies.inputs[:60]), drawn.center_uvd[:60]


def estimates(
    model: CapsuleModel,
    poses: Poses,
    size: float = 0.93,
    side: Side = "right",
    fitted: float = 1.0,
    confidence: float = 1.0,
    cost: float = 1.0,
) -> list[HandEstimate]:
    """Estimates of hands of this size, or of their mirror images, with small errors and sizes
    about ``fitted``.
    """
    x, uvd = poses[0].copy(), poses[1]
    x[:, SIZE_INDEX] = np.log(size)
    depth = render_crop(model.capsules(x, NYU.unproject(uvd)), uvd, 300.0)
    crops = normalise_depth(depth, uvd[:, 2], 300.0)
    x += np.random.default_rng(0).normal(0, 0.03, x.shape)
    x[:, SIZE_INDEX] = np.log(fitted) + np.random.default_rng(1).normal(0, 0.05, len(x))
    camera = camera_of(NYU, side)
    fits: Any = [SimpleNamespace(x=row[None], cost=np.array([cost])) for row in x]
    return [
        HandEstimate(
            side,
            crop,
            center,
            300.0,
            camera,
            np.zeros((31, 3)),
            fit,
            model,
            error_mm=1.0,
            confidence=confidence,
        )
        for crop, center, fit in zip(crops, uvd, fits)
    ]


def kept(
    model: CapsuleModel, hands: Sequence[HandEstimate], every: float = 0.2
) -> list[tuple[int, float]]:
    """The sizes that a keeper finds, with the number of poses until then."""
    keeper = SizeKeeper(DepthFitter(model), SETTINGS)
    sizes: list[float | None] = []
    for n, hand in enumerate(hands):
        keeper.take(hand, n * every)
        sizes.append(keeper.size)
    return [(n, size) for n, size in enumerate(sizes, 1) if size is not None][:1]


@pytest.mark.parametrize(("side", "other"), [("right", "left"), ("left", "right")])
def test_the_size_of_a_hand(model: CapsuleModel, poses: Poses, side: Side, other: Side) -> None:
    """The size is known after enough frames, and remains; earlier sights as the other side do not
    count.
    """
    hands = estimates(model, poses, side=side)
    [(count, size)] = kept(model, hands)
    assert count == SETTINGS.poses and size == pytest.approx(0.93, abs=0.02)
    [(later, same)] = kept(model, [*estimates(model, poses, side=other)[:20], *hands])
    assert later == SETTINGS.poses + 20 and same == pytest.approx(size)


def test_the_half_of_the_poses_that_costs_more_does_not_count(
    model: CapsuleModel, poses: Poses
) -> None:
    pairs = zip(estimates(model, poses), estimates(model, poses, 1.1, cost=2.0))
    [(_, size)] = kept(model, [hand for pair in pairs for hand in pair])
    assert size == pytest.approx(0.93, abs=0.02)


@pytest.mark.parametrize(("size", "fitted"), [(0.761, 0.72), (0.93, 0.8), (1.329, 1.25)])
def test_a_size_far_from_what_was_expected(
    model: CapsuleModel, poses: Poses, size: float, fitted: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The true size is found although the hands were fitted with another one."""
    monkeypatch.setattr(sizing, "POPULATION", np.inf)  # no prior
    [(_, found)] = kept(model, estimates(model, poses, size, fitted=fitted))
    assert found == pytest.approx(size, abs=0.015)


def test_most_people_have_a_typical_size(
    model: CapsuleModel, poses: Poses, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The prior pulls to it; its deviation is that of the recipe of the packaged weights."""
    hands = estimates(model, poses, 0.99)
    prior = recipe("people").prior
    assert prior.scale_std / prior.scale_mean == pytest.approx(POPULATION, abs=0.001)
    [(_, size)] = kept(model, hands)
    assert size == pytest.approx(0.99, abs=0.02)  # the prior counts as one frame
    sizes = []
    for deviation in (0.01, 0.3, np.inf):
        monkeypatch.setattr(sizing, "POPULATION", deviation)
        [(_, size)] = kept(model, hands)
        sizes.append(size)
    assert sizes[0] < sizes[1] < sizes[2]
    assert (sizes[0], sizes[2]) == pytest.approx((TYPICAL_SIZE, 0.99), abs=0.015)


@pytest.mark.parametrize(
    ("costs", "step"),
    [
        ([2.0, 1.0, 2.0], 0.0),
        ([1.0, 1.0, 2.0], -0.05),  # the minimum of a parabola
        # the first or last size if the costs decrease towards it
        ([1.0, 3.0, 4.0], -0.1),
        ([4.0, 3.0, 1.0], 0.1),
        ([1.0, 1.5, 2.1], -0.1),
    ],
)
def test_the_least_of_few_costs(costs: list[float], step: float) -> None:
    assert lowest(np.exp([-0.1, 0.0, 0.1]), np.array(costs)) == pytest.approx(np.exp(step))


@pytest.mark.parametrize(
    ("confidence", "every"), [(0.3, 0.2), (1.0, 0.001)], ids=["uncertain", "too soon"]
)
def test_uncertain_and_too_frequent_frames_are_not_kept(
    model: CapsuleModel, poses: Poses, confidence: float, every: float
) -> None:
    assert kept(model, estimates(model, poses, confidence=confidence), every) == []
