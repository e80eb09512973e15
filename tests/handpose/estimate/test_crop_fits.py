"""handpose/estimate/crop_fits.py: the fits of crops"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

import netlib
from handpose.estimate.crop_fits import fit_crops, fit_starts
from handpose.estimate.nets import best_fit, hand_poses
from handpose.estimate.packaged import load_predictor
from handpose.estimate.predictor import Predictor
from handpose.fit.body import SIZE_INDEX, CapsuleModel
from handpose.fit.depth_fit import DepthFit, DepthFitter
from handpose.fit.observation import HandCrops
from handpose.fit.settings import SearchSettings
from handpose.frames.cameras import NYU
from handpose.synthetic.generator import Generator, Recipe, Scene, SyntheticCamera
from netlib.net import Net
from tests.handpose.estimate.conftest import NetOf
from tests.support.packaged_hand import EXACT

HEADS = """
layer { name: "data" type: "Input" top: "depth" input_param { shape { dim: 1 dim: 1 dim: 128 dim: 128 } } }
layer { name: "DoF" type: "InnerProduct" bottom: "depth" top: "DoF" inner_product_param { num_output: 47 } }
layer { name: "size" type: "InnerProduct" bottom: "depth" top: "size" inner_product_param { num_output: 1 } }
layer { name: "joints" type: "InnerProduct" bottom: "depth" top: "joints" inner_product_param { num_output: 93 } }
layer { name: "hand" type: "HandModel" bottom: "DoF" bottom: "size" top: "pred"
        hand_model_param { skeleton: "prototxt/hand/people.prototxt" } }
"""


@pytest.fixture(scope="module")
def predictor() -> Predictor:
    """The packaged predictor with the fast fit."""
    return load_predictor(fit="fast", hand="right")


@pytest.fixture(scope="module")
def scene() -> Scene:
    """Some synthetic frames of NYU's camera."""
    return Generator(9, recipe=Recipe(EXACT, views=(SyntheticCamera(NYU, None),))).scene(0)


def fits(predictor: Predictor, scene: Scene, count: int, **options: Any) -> DepthFit:
    """The fits of the first frames."""
    hands = HandCrops(scene.depth[:count], scene.center_uvd[:count], NYU, 300.0)
    return fit_crops(predictor.net, predictor.fitter, hands, SearchSettings().fast, **options)


def test_blocks_change_nothing(
    predictor: Predictor, scene: Scene, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Ten crops at once or four at a time give the same fits to rounding, which may lead a few fits
    to other minima.
    """
    whole = fits(predictor, scene, 10)
    monkeypatch.setattr("handpose.estimate.crop_fits.MAX_CROPS", 4)
    parts = fits(predictor, scene, 10)
    apart = np.linalg.norm(parts.joints - whole.joints, axis=2).max(axis=1)  # mm
    assert np.median(apart) < 0.1 and (apart < 1).mean() >= 0.7
    assert whole.x.shape == (10, predictor.fitter.model.variables)


def test_a_known_size(predictor: Predictor, scene: Scene) -> None:
    assert np.exp(fits(predictor, scene, 2, size=0.95).x[:, SIZE_INDEX]) == pytest.approx(
        0.95, abs=3e-3
    )


def crops(count: int) -> np.ndarray:
    """Crops of noise."""
    return np.random.default_rng(0).uniform(-1, 1, (count, 128, 128)).astype(np.float32)


@pytest.fixture
def net(net_of: NetOf) -> Net:
    """A net with a constant output: the initial pose, scaled by 0.9, and the joints of
    its hand model.
    """
    net = net_of(HEADS, netlib.TEST)
    for name in ("DoF", "size", "joints"):
        net.params[name][0].data[...] = 0
    net.params["size"][1].data[...] = 0.9
    net.params["joints"][1].data[...] = net.forward(depth=crops(1)[:, None])["pred"][0]
    return net


def test_of_a_net_with_sizes(net: Net, model: CapsuleModel) -> None:
    """The start has the size that the net predicts, and the joints of its hand model."""
    (x,) = fit_starts(net, DepthFitter(model), crops(2), (0,))
    assert x.shape == (2, model.variables) and best_fit(net) == "accurate"
    assert_allclose(np.exp(x[:, SIZE_INDEX]), 0.9, atol=0.003)
    assert_allclose(model.joints(x)[0] / 150, net.blobs["pred"].data[0].reshape(31, 3), atol=0.02)


def test_starts_are_moved_to_the_predicted_joints(net: Net, model: CapsuleModel) -> None:
    """Some nets predict joints in addition to their hand model."""
    net.params["joints"][1].data.reshape(31, 3)[:, 0] += 0.2
    poses, (x,) = hand_poses(net, crops(1)), fit_starts(net, DepthFitter(model), crops(1), (0,))
    assert poses.joints is not None
    assert_allclose(poses.joints[0].ravel(), net.params["joints"][1].data, atol=1e-6)
    off = model.joints(x)[0] / 150 - poses.joints[0]
    assert np.linalg.norm(off, axis=1).max() < 0.02


def test_turned_crops(net: Net, model: CapsuleModel) -> None:
    """A net with a constant output gives starts that are turned back with the crops by
    quarter turns.
    """
    plain, turned = (
        model.joints(x)[0] for x in fit_starts(net, DepthFitter(model), crops(1), (0, 1))
    )
    clockwise = np.array([[0, 1, 0], [-1, 0, 0], [0, 0, 1.0]])
    assert_allclose(turned, plain @ clockwise.T, atol=1.0)
