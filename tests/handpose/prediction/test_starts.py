"""handpose/prediction/starts.py: where fits start, from what a net sees."""

from __future__ import annotations

import numpy as np
import pytest

import netlib
from handpose.depth_fit.body import SIZE, FleshModel
from handpose.prediction.nets import hand_layer, hand_poses
from handpose.prediction.starts import fit_starts
from layers.hand.skeleton import load
from netlib.net import Net
from tests.handpose.prediction.conftest import NetOf

HEADS = """
layer { name: "data" type: "Input" top: "depth" input_param { shape { dim: 1 dim: 1 dim: 128 dim: 128 } } }
layer { name: "DoF" type: "InnerProduct" bottom: "depth" top: "DoF" inner_product_param { num_output: 47 } }
layer { name: "size" type: "InnerProduct" bottom: "depth" top: "size" inner_product_param { num_output: 1 } }
layer { name: "joints" type: "InnerProduct" bottom: "depth" top: "joints" inner_product_param { num_output: 93 } }
layer { name: "hand" type: "HandModel" bottom: "DoF" bottom: "size" top: "pred" }
"""


def crops(count: int) -> np.ndarray:
    """Crops of anything."""
    return np.random.default_rng(0).uniform(-1, 1, (count, 128, 128)).astype(np.float32)


@pytest.fixture
def net(net_of: NetOf) -> Net:
    """Says the same of every crop: the initial pose, 0.9 times as large; joints that are moved by 30 mm along x."""
    net = net_of(HEADS, netlib.TEST)
    for name in ("DoF", "size", "joints"):
        net.params[name][0].data[...] = 0
    net.params["size"][1].data[...] = 0.9
    return net


def test_of_a_net_with_sizes(net: Net) -> None:
    """The size that the net says, and the joints of its hand model."""
    model = FleshModel(load(), 150.0)
    net.params["joints"][1].data[...] = net.forward(depth=crops(1)[:, None])["pred"][0]
    (x,) = fit_starts(net, model, crops(2), (0,))
    assert x.shape == (2, model.variables)
    np.testing.assert_allclose(np.exp(x[:, SIZE]), 0.9, atol=0.003)
    found = model.joints(x) / 150
    np.testing.assert_allclose(found[0], net.blobs["pred"].data[0].reshape(31, 3), atol=0.02)


def test_moved_to_the_joints(net: Net) -> None:
    """Where a net says joints beside its hand model, the start is near those."""
    model = FleshModel(load(), 150.0)
    aim = net.forward(depth=crops(1)[:, None])["pred"][0].reshape(31, 3) + (0.2, 0, 0)
    net.params["joints"][1].data[...] = aim.reshape(-1)
    poses = hand_poses(net, crops(1))
    assert poses.joints is not None
    np.testing.assert_allclose(poses.joints[0], aim, atol=1e-6)
    (x,) = fit_starts(net, model, crops(1), (0,))
    assert np.linalg.norm(model.joints(x)[0] / 150 - aim, axis=1).max() < 0.02


def test_turned_crops(net: Net) -> None:
    """Turned back with the crops: a net that says the same of all of them sees four hands, turned by quarters."""
    model, layer = FleshModel(load(), 150.0), hand_layer(net)
    assert layer is not None
    net.params["joints"][1].data[...] = net.forward(depth=crops(1)[:, None])["pred"][0]
    plain, turned = (model.joints(x)[0] for x in fit_starts(net, model, crops(1), (0, 1)))
    clockwise = np.array([[0, 1, 0], [-1, 0, 0], [0, 0, 1.0]])
    np.testing.assert_allclose(turned, plain @ clockwise.T, atol=1.0)
