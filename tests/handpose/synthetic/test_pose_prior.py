"""handpose/synthetic/pose_prior.py"""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from handpose.body.nyu import CENTER_IN_PALM
from handpose.synthetic import prior_file
from handpose.synthetic.pose_prior import Bodies, BodySampler
from handpose.synthetic.prior_parameters import ProportionParameter
from layers.hand.bodies import kinematics_of
from netlib.proto import schema


@pytest.fixture(scope="module")
def hands(sampler: BodySampler) -> Bodies:
    """Hands of the default prior."""
    return sampler.draw(np.random.default_rng(0), 500)


def test_bones_vary_within_reason(sampler: BodySampler, hands: Bodies) -> None:
    """Bone lengths are those of the frame, which vary by a factor per hand and one per bone."""
    skeleton = sampler.skeleton
    child = np.flatnonzero(skeleton.parents >= 0)
    lengths = np.linalg.norm(
        hands.joints[:, child] - hands.joints[:, skeleton.parents[child]], axis=2
    )
    assert_allclose(lengths, np.abs(hands.bones[:, child]), atol=1e-12)
    own = lengths / np.abs(skeleton.bones[child]) / hands.scale[:, None]
    assert own.std() == pytest.approx(0.04, rel=0.1)
    assert hands.scale.std() == pytest.approx(0.06, rel=0.15)
    assert np.abs(own - 1).max() <= 0.1 + 1e-9
    assert np.abs(hands.scale - 1).max() <= 0.15 + 1e-9


def test_parameters_are_the_models(sampler: BodySampler, hands: Bodies) -> None:
    """``dof`` is within the limits, 0 where fixed, and poses the packaged hand within a few mm
    of the labels.
    """
    skeleton = sampler.skeleton
    assert (hands.inputs >= skeleton.lower - 1e-12).all()
    assert (hands.inputs <= skeleton.upper + 1e-12).all()
    assert (hands.inputs[:, skeleton.fixed] == 0).all()
    kinematics = kinematics_of(skeleton)
    assert_allclose(kinematics.joints(hands.inputs, hands.bones[:, :31]), hands.joints, atol=1e-12)
    nearly = np.linalg.norm(kinematics.joints(hands.inputs) - hands.joints, axis=2) * 150
    assert 1 < nearly.mean() < 6


def test_fingers_rarely_run_through_each_other(sampler: BodySampler, hands: Bodies) -> None:
    """In fewer than 1% of the hands, parts penetrate each other more than the prior allows."""
    surface = sampler.surface
    inputs = np.zeros((500, len(sampler.surface.whole.initial)))
    inputs[:, : hands.inputs.shape[1]] = hands.inputs
    ends = surface.ends(surface.kinematics.forward(inputs, hands.bones), hands.scale)
    depth = surface.penetration(ends, surface.radii * hands.scale[:, None, None]) * 150
    assert (depth > prior_file.load().penetration + 1).mean() < 0.01


def test_center_is_in_the_palm(sampler: BodySampler, hands: Bodies) -> None:
    """The prior's crop centre is NYU's joint 34; the hands lie about it, up to the jitter."""
    assert_allclose(sampler.center * 150, CENTER_IN_PALM, atol=1e-12)
    distance = (
        np.linalg.norm(hands.joints[:, sampler.skeleton.joint_names.index("palm")], axis=1) * 150
    )
    assert np.median(distance) == pytest.approx(np.linalg.norm(CENTER_IN_PALM), abs=2)
    assert distance.max() < 70


def test_bones_of_a_group_differ_together(rng: np.random.Generator) -> None:
    """All bones of a group are scaled by one factor; other bones keep the body's size."""
    group = ProportionParameter(("index_pip_a", "index_pip_b"), 0.1)
    prior = prior_file.load().but(scale_mean=0.8, scale_std=0.0, bone_std=0.0, proportion=(group,))
    sampler = BodySampler(prior)
    bones, own = sampler.draw(rng, 500).bones, sampler.surface.whole.bones
    index = [sampler.skeleton.joint_names.index(joint) for joint in group.joint]
    others = np.setdiff1d(np.arange(len(own)), index)
    assert_allclose(bones[:, others], np.tile(0.8 * own[others], (500, 1)))
    factor = bones[:, index] / own[index]
    assert_allclose(factor[:, 0], factor[:, 1])
    assert factor[:, 0].std() == pytest.approx(0.08, rel=0.15)


def test_people_are_seen_from_every_side(rng: np.random.Generator) -> None:
    """The directions of palms and fingers are distributed evenly over the eight octants."""
    sampler = BodySampler(prior_file.load(prior_file.PEOPLE_PRIOR))
    everywhere = tuple(schema.changed(turn, any=1.0) for turn in sampler.prior.turn)
    angles = BodySampler(sampler.prior.but(turn=everywhere)).rotations(rng, 4000)
    for axis in np.eye(3):
        pointing = Rotation.from_euler("ZXY", angles).apply(axis) > 0
        octant = np.bincount(pointing @ [1, 2, 4], minlength=8)
        assert octant == pytest.approx([500] * 8, rel=0.15)
