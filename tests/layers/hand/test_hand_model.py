"""HandModel: kinematics as a layer, for the hand and for another body."""

import numpy as np
import pytest

import netlib
from layers.hand.bodies import kinematics_of
from layers.hand.skeleton import load


@pytest.fixture
def text(tmp_path, arm_text):
    """The layer on the planar arm."""
    (tmp_path / "arm.prototxt").write_text(arm_text)
    return f'type: "HandModel" hand_model_param {{ skeleton: "{tmp_path}/arm.prototxt" }}'


def test_another_body_is_another_file(run, text, arm, rng):
    """Nothing about hands is in the code: inputs (N, 4), joints (N, 9)."""
    x = rng.normal(size=(5, 4))
    assert np.allclose(run(text, x).y, arm(x).reshape(5, 9))


def test_the_default_is_the_hand(run, rng):
    """x y z of joint 0, then of joint 1, and so on."""
    x = rng.normal(size=(3, 47))
    y = run('type: "HandModel"', x).y
    assert y.shape == (3, 93)
    assert np.allclose(y.reshape(3, 31, 3), kinematics_of(load()).joints(x))


@pytest.mark.parametrize("force", ["true", "false"])
def test_a_batch_of_nothing(net_of, force):
    """No hands, no joints, no gradient; for a net that predicts and for one that learns."""
    net = net_of(f"""
        force_backward: {force}
        layer {{ name: "x" type: "Input" top: "x" input_param {{ shape {{ dim: 2 dim: 47 }} }} }}
        layer {{ name: "hand" type: "HandModel" bottom: "x" top: "y" }}
    """)
    assert net.forward(x=np.zeros((0, 47)))["y"].shape == (0, 93)
    if force == "true":
        assert net.backward(y=np.zeros((0, 93)))["x"].shape == (0, 47)


def test_gradient_of_the_arm(check, text, rng):
    """Every input."""
    check(text, rng.normal(size=(3, 4)))


@pytest.mark.parametrize("name", ["HandModel", "DeepHandModel"])
def test_gradient_of_the_hand(check, rng, name):
    """0 for fixed DoFs; the inputs may have more axes."""
    check(f'type: "{name}"', rng.normal(0, 0.5, (2, 47, 1)))


def test_a_net_that_only_predicts_gives_the_same(net_of, rng):
    """Without backward less is computed."""
    text = (
        '%s layer { name: "x" type: "Input" top: "x" input_param { shape { dim: 9 dim: 47 } } } '
        'layer { name: "h" type: "HandModel" bottom: "x" top: "y" }'
    )
    x = rng.normal(size=(9, 47))
    found = [net_of(text % start, dtype=np.float64).forward(x=x)["y"] for start in ("", "force_backward: true")]
    assert np.allclose(*found, atol=1e-14)


def test_the_skeleton_is_found_beside_the_net(tmp_path, monkeypatch, arm_text):
    """Or from the working directory, Caffe's way."""
    (tmp_path / "arm.prototxt").write_text(arm_text)
    (tmp_path / "net.prototxt").write_text(
        'layer { name: "x" type: "Input" top: "x" input_param { shape { dim: 1 dim: 4 } } } '
        'layer { name: "h" type: "HandModel" bottom: "x" top: "y" hand_model_param { skeleton: "arm.prototxt" } }'
    )
    for folder in ("/", tmp_path):
        monkeypatch.chdir(folder)
        assert netlib.Net(tmp_path / "net.prototxt").forward()["y"].shape == (1, 9)


def test_mistakes(run, text):
    """Another number of inputs; a skeleton that is not there."""
    with pytest.raises(
        netlib.LayerError, match=r"bottom 'bottom0' has shape \(2, 5\), skeleton 'arm' expects \(2, 4\)"
    ):
        run(text, np.zeros((2, 5)))
    with pytest.raises(netlib.NetlibError, match=r"gone.prototxt: cannot read"):
        run(text.replace("arm.prototxt", "gone.prototxt"), np.zeros((2, 4)))
