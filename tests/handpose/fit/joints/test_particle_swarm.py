"""Particle swarm optimisation, as in the paper."""

import numpy as np
import pytest

from handpose.body.nyu import EVALUATION_JOINTS
from handpose.fit.joints.fit_joints import fit_joints
from handpose.fit.joints.particle_swarm import fit_joints_by_swarm
from handpose.synthetic.pose_prior import BodySampler
from layers.hand import skeleton as skeletons
from layers.hand.bodies import kinematics_of
from netlib.errors import DataError
from tests.support.made_tracks import skeleton_of

NYU_HAND = skeletons.load()  # the labels that are fitted are of NYU's joints


def test_swarm_comes_near_but_fit_comes_nearer():
    """For three hands the swarm's error is below 0.15 half-cubes, and never below that of
    ``fit_joints``.
    """
    inputs = BodySampler().draw(np.random.default_rng(7), 40).inputs[:3]
    targets = kinematics_of(NYU_HAND).joints(inputs)[:, EVALUATION_JOINTS]
    swarm = fit_joints_by_swarm(NYU_HAND, targets, EVALUATION_JOINTS, particles=64, generations=150)
    best = fit_joints(NYU_HAND, targets, EVALUATION_JOINTS)
    assert (swarm.inputs >= np.maximum(NYU_HAND.lower, -20)).all()
    assert (swarm.inputs <= np.minimum(NYU_HAND.upper, 20)).all()
    assert best.residuals.mean() <= swarm.residuals.mean() < 0.15


def test_a_swarm_on_a_body_without_limits():
    """Rotations without limits are searched within one turn; translations without limits
    raise an error.
    """
    text = """dof { name: "turn" } dof { name: "slide" %s }
        joint { name: "root" rotate { axis: Z dof: "turn" } bone { axis: X length: 1 } }
        joint { name: "tip" parent: "root" translate { axis: X dof: "slide" } }"""
    free, bound = (skeleton_of(text % limits) for limits in ("", "lower: 0 upper: 1"))
    inputs = np.array([[-2.5, 0.3]])
    assert np.allclose(
        fit_joints_by_swarm(bound, kinematics_of(bound).joints(inputs)).inputs, inputs, atol=1e-3
    )
    with pytest.raises(DataError, match="'' has translations without limits"):
        fit_joints_by_swarm(free, kinematics_of(free).joints(inputs))
