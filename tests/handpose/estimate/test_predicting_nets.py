"""handpose/estimate/nets.py: the inputs of a net's hand model."""

from __future__ import annotations

import numpy as np
import pytest

from handpose.estimate.nets import hand_poses, skeleton_to_fit
from handpose.estimate.packaged import load_predictor
from handpose.frames.cameras import NYU
from handpose.synthetic.generator import Generator
from handpose.synthetic.recipes import recipe
from layers.hand.bodies import kinematics_of
from netlib.net import Net


@pytest.fixture
def net() -> Net:
    """The packaged net, before its first run."""
    return load_predictor(NYU, fit="no", hand="right").net


@pytest.fixture
def crops() -> np.ndarray:
    """Three rendered hands."""
    return Generator(3, recipe=recipe("people")).scene(0).depth[:3]


def test_predicted_poses_give_the_joints_of_the_net(net: Net, crops: np.ndarray) -> None:
    """Posing the skeleton with the inputs, in the predicted size, gives the net's joints;
    fixed DoFs are 0.
    """
    poses, skeleton = hand_poses(net, crops), skeleton_to_fit(net)
    assert poses.inputs.dtype == np.float64 and (poses.inputs[:, skeleton.fixed] == 0).all()
    posed = kinematics_of(skeleton).joints(poses.inputs, poses.size[:, None] * skeleton.bones)
    assert ((poses.size > 0.5) & (poses.size < 2)).all(), poses.size  # other sizes are clipped
    expected = net.forward(depth=crops[:, None])["pred"]
    np.testing.assert_allclose(posed.reshape(3, -1), expected, atol=1e-5)
