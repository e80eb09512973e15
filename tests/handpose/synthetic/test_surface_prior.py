"""handpose/synthetic/surface_prior.py"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from handpose.body.capsules import CLEAR_MM, Capsules
from handpose.synthetic.pose_prior import BodySampler
from handpose.synthetic.surface_prior import DEFAULT_SURFACE, SurfacePrior
from tests.handpose.drawn_hands import capsules_of

EXACT = replace(DEFAULT_SURFACE, thickness_std=0)


def drawn(
    sampler: BodySampler, prior: SurfacePrior, count: int = 300, depth: float = 800
) -> Capsules:
    """The capsules of hands in front of a camera."""
    rng = np.random.default_rng(0)
    return capsules_of(sampler, rng, sampler.draw(rng, count), (0, 0, depth), prior)


def test_forearms_do_not_point_at_the_camera(sampler: BodySampler) -> None:
    """The forearm, the last capsule, rarely points at the camera more than the prior allows."""
    surface = drawn(sampler, DEFAULT_SURFACE)
    arm = surface.b[:, -1] - surface.a[:, -1]
    towards = -arm[:, 2] / np.linalg.norm(arm, axis=1)
    assert (towards > DEFAULT_SURFACE.towards_camera).mean() < 0.02
    assert (drawn(sampler, replace(DEFAULT_SURFACE, redraws=0)).b[:, -1, 2] < 700).mean() > 0.1


def test_thickness_and_single_radii(sampler: BodySampler, rng: np.random.Generator) -> None:
    """Radii are those of the file, times a thickness per hand and a factor per radius."""
    size = sampler.draw(rng, 300).scale
    own = sampler.surface.radii[:, 0] * 150
    exact = drawn(sampler, EXACT).radius_a / size[:, None]
    assert_allclose(exact, np.broadcast_to(own, exact.shape))
    together = drawn(sampler, DEFAULT_SURFACE).radius_a / size[:, None] / own
    assert np.ptp(together, axis=1).max() < 1e-12
    assert together[:, 0].std() == pytest.approx(0.08, rel=0.15)
    single = drawn(sampler, replace(EXACT, radius_std=0.1)).radius_a / size[:, None] / own
    assert single.std(axis=1).mean() == pytest.approx(0.1, rel=0.1)


def test_offsets(sampler: BodySampler, rng: np.random.Generator) -> None:
    """With offsets of 0, capsules end at the joints."""
    own = ~sampler.surface.limbs
    hands = sampler.draw(rng, 10)
    joints = hands.joints[:, sampler.surface.start[own]] * 150 + (0, 0, 800)
    assert_allclose(
        drawn(sampler, replace(EXACT, offsets=(0.0, 0.0)), 10).a[:, own], joints, atol=1e-9
    )


def test_cut_forearms_and_sleeves(sampler: BodySampler) -> None:
    """A cut forearm is shorter; a sleeve surrounds it from a given place to its end,
    and is thicker.
    """
    whole, cut = drawn(sampler, EXACT), drawn(sampler, replace(EXACT, cut=1.0, cut_at=(0.25, 0.25)))
    length = [np.linalg.norm(c.b[:, -1] - c.a[:, -1], axis=1) for c in (whole, cut)]
    assert_allclose(length[1], length[0] / 4)
    worn = drawn(
        sampler, replace(EXACT, sleeve=1.0, sleeve_from=(0.5, 0.5), sleeve_mm=(10.0, 10.0))
    )
    arm, sleeve = (Capsules(*(values[:, m] for values in worn)) for m in (-2, -1))
    assert_allclose(sleeve.a, (arm.a + arm.b) / 2)
    assert_allclose(sleeve.b, arm.b)
    assert_allclose(sleeve.radius_b, arm.radius_b + 10)


def test_a_forearm_ends_before_the_camera(sampler: BodySampler) -> None:
    """No part of the forearm is nearer to the camera's plane than CLEAR_MM, so that it
    can be rendered.
    """
    near = drawn(sampler, replace(EXACT, redraws=0), depth=260)
    assert (near.b[:, -1, 2] - near.radius_b[:, -1]).min() >= CLEAR_MM - 1e-9
    assert (drawn(sampler, EXACT, depth=900).b[:, -1, 2] > 500).all()


def test_palms_are_thicker_than_fingers(sampler: BodySampler) -> None:
    """The palm's radii have a factor of their own; those of fingers and arms have
    the common one.
    """
    prior = replace(EXACT, thickness_mean=1.5, trunk_mean=2.0)
    thin, thick = (drawn(sampler, own, count=20) for own in (EXACT, prior))
    factor = np.concatenate([thick.radius_a / thin.radius_a, thick.radius_b / thin.radius_b])
    parts = np.array(sampler.surface.parts)
    assert_allclose(factor[:, parts == "palm"], 3.0)
    assert_allclose(factor[:, (parts == "thumb") | (parts == "index") | sampler.surface.limbs], 1.5)
