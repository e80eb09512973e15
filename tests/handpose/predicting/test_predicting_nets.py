"""handpose/predicting/nets.py: what a net feeds its hand model."""

from __future__ import annotations

import numpy as np
import pytest

from handpose.facts.cameras import NYU
from handpose.predicting.nets import hand_inputs, skeleton_to_fit
from handpose.predicting.packaged import load_predictor
from layers.hand.bodies import kinematics_of
from netlib.net import Net


@pytest.fixture
def net() -> Net:
    """The packaged one, which nobody has run or looked at yet."""
    return load_predictor(NYU, fit="no", hand="right").net


@pytest.fixture
def crops() -> np.ndarray:
    """Three crops of anything."""
    return np.random.default_rng(0).uniform(-1, 1, (3, 128, 128)).astype(np.float32)


def test_the_hand_model_takes_them(net: Net, crops: np.ndarray) -> None:
    """Posing the skeleton by them gives the net's joints; fixed DoFs are 0."""
    inputs, skeleton = hand_inputs(net, crops), skeleton_to_fit(net)
    assert inputs.dtype == np.float64 and (inputs[:, skeleton.fixed] == 0).all()
    posed = kinematics_of(skeleton).joints(inputs)
    np.testing.assert_allclose(posed.reshape(3, -1), net.forward(depth=crops[:, None])["pred"], atol=1e-5)


def test_a_net_computes_the_same_before_and_after(net: Net, crops: np.ndarray) -> None:
    """To the last bit, and so do predictions, whichever frames were seen before."""
    depth = crops[:1, None]
    net.blobs["depth"].reshape(*depth.shape)
    before = net.forward(depth=depth)["pred"].copy()
    inputs = hand_inputs(net, crops[:1])
    hand_inputs(net, crops)
    net.blobs["depth"].reshape(*depth.shape)
    np.testing.assert_array_equal(net.forward(depth=depth)["pred"], before)
    np.testing.assert_array_equal(hand_inputs(net, crops[:1]), inputs)
