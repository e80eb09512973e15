"""handpose/synthetic/pose_prior.py"""

from __future__ import annotations

import numpy as np
import pytest

from handpose.facts.nyu import CENTER_IN_PALM
from handpose.synthetic import prior_file
from handpose.synthetic.pose_prior import BodySampler
from layers.hand.bodies import kinematics_of


@pytest.fixture(scope="module")
def sampler() -> BodySampler:
    """The default sampler."""
    return BodySampler()


def test_bones_vary_within_reason(sampler: BodySampler) -> None:
    """Joints are apart by their frame's bones, which are the skeleton's times a hand's and a bone's own factor."""
    hands = sampler.draw(np.random.default_rng(0), 500)
    skeleton = sampler.skeleton
    child = np.flatnonzero(skeleton.parents >= 0)
    lengths = np.linalg.norm(hands.joints[:, child] - hands.joints[:, skeleton.parents[child]], axis=2)
    np.testing.assert_allclose(lengths, np.abs(hands.bones[:, child]), atol=1e-12)
    own = lengths / np.abs(skeleton.bones[child]) / hands.scale[:, None]
    assert own.std() == pytest.approx(0.04, rel=0.1)
    assert hands.scale.std() == pytest.approx(0.06, rel=0.15)
    assert np.abs(own - 1).max() <= 0.1 + 1e-9 and np.abs(hands.scale - 1).max() <= 0.15 + 1e-9


def test_parameters_are_the_models(sampler: BodySampler) -> None:
    """``dof`` is within the limits, 0 where fixed, and poses the packaged hand within a few mm of the labels."""
    hands = sampler.draw(np.random.default_rng(0), 500)
    skeleton = sampler.skeleton
    assert (hands.inputs >= skeleton.lower - 1e-12).all() and (hands.inputs <= skeleton.upper + 1e-12).all()
    assert (hands.inputs[:, skeleton.fixed] == 0).all()
    kinematics = kinematics_of(skeleton)
    np.testing.assert_allclose(kinematics.joints(hands.inputs, hands.bones[:, :31]), hands.joints, atol=1e-12)
    nearly = np.linalg.norm(kinematics.joints(hands.inputs) - hands.joints, axis=2) * 150
    assert 1 < nearly.mean() < 6


def test_fingers_rarely_run_through_each_other(sampler: BodySampler) -> None:
    """Hardly a hand has parts deeper in each other than the prior allows."""
    hands = sampler.draw(np.random.default_rng(0), 500)
    flesh, inputs = sampler.flesh, np.zeros((500, len(sampler.flesh.whole.initial)))
    inputs[:, : hands.inputs.shape[1]] = hands.inputs
    ends = flesh.ends(flesh.kinematics.forward(inputs, hands.bones), hands.scale)
    depth = flesh.penetration(ends, flesh.radii * hands.scale[:, None, None]) * 150
    assert (depth > prior_file.load().penetration + 1).mean() < 0.01


def test_center_is_in_the_palm(sampler: BodySampler) -> None:
    """The prior's crop centre is NYU's joint 34; it lies as far from the palm joint, give or take the jitter."""
    np.testing.assert_allclose(sampler.center * 150, CENTER_IN_PALM, atol=1e-12)
    hands = sampler.draw(np.random.default_rng(0), 500)
    distance = np.linalg.norm(hands.joints[:, sampler.skeleton.joint_names.index("palm")], axis=1) * 150
    assert np.median(distance) == pytest.approx(np.linalg.norm(CENTER_IN_PALM), abs=2)
    assert distance.max() < 70
