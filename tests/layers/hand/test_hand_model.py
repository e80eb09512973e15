"""HandModel: kinematics as a layer, for the hand and for other skeletons.

A second bottom has sizes: a factor (N, 1), or the lengths of the bones (N, joints).
"""

import re

import numpy as np
import pytest

import netlib
from layers.hand.kinematics import Kinematics
from tests.support.bad_input import bad_inputs
from tests.support.nets import inputs

LAYER = 'type: "HandModel" hand_model_param {{ skeleton: "{}" }}'


@pytest.fixture
def arm_layer(tmp_path, arm_text):
    """The layer with the skeleton of the planar arm."""
    path = tmp_path / "arm.prototxt"
    path.write_text(arm_text)
    return LAYER.format(path)


@pytest.fixture
def any_skeleton(skeleton, any_body):
    """A random skeleton of 6 joints and 6 DoFs."""
    return skeleton(any_body)


@pytest.fixture
def any_layer(tmp_path, any_body):
    """The layer with the skeleton ``any_skeleton``."""
    path = tmp_path / "any.prototxt"
    path.write_text(any_body)
    return LAYER.format(path)


def test_another_body_is_another_file(run, arm_layer, arm, rng):
    """The arm's layer maps inputs (N, 4) to its joints (N, 9)."""
    x = rng.normal(size=(5, 4))
    assert np.allclose(run(arm_layer, x).y, arm(x).reshape(5, 9))


@pytest.mark.parametrize("N", [2, 20])
def test_a_factor_scales_the_skeleton(run, any_layer, any_skeleton, rng, N):
    """A factor per item scales bones and initial translations, including those of fixed DoFs."""
    x, factors = rng.normal(size=(N, 6)), rng.normal(size=(N, 1, 1))
    y = run(any_layer, x, factors).y.reshape(N, 6, 3)
    for n, factor in enumerate(factors.ravel()):
        scaled = Kinematics(any_skeleton.scaled(float(factor)))
        assert np.allclose(y[n], scaled.joints(x[n : n + 1]))


def test_lengths_replace_the_bones(run, any_layer, any_skeleton, rng):
    """A length per joint replaces its bone, with its sign; lengths of joints without a
    bone are ignored.
    """
    x, lengths = rng.normal(size=(3, 6)), rng.normal(size=(3, 6))
    assert (any_skeleton.bone_axes < 0).any()
    y = run(any_layer, x, lengths).y.reshape(3, 6, 3)
    for n in range(3):
        changed = any_skeleton.with_numbers(any_skeleton.param.dof, lengths[n])
        assert np.allclose(y[n], Kinematics(changed).joints(x[n : n + 1]))


@pytest.mark.parametrize(
    ("N", "shape"), [(2, (1,)), (2, (6,)), (2, (1, 1)), (2, (3, 2)), (17, (1,)), (17, (6,))]
)
def test_gradient_of_the_sizes(check, any_layer, rng, N, shape):
    """Sizes are a factor or the lengths of all bones, in any shape (N, ...)."""
    check(any_layer, rng.normal(size=(N, 6)), rng.normal(size=(N, *shape)))


@pytest.mark.parametrize("sizes", [1, 31])
def test_only_the_wanted_gradients_are_written(run, rng, sizes):
    """A gradient is the same with and without the other."""
    layer = run('type: "HandModel"', rng.normal(size=(4, 47)), rng.uniform(0.5, 1.5, (4, sizes)))
    dy = rng.normal(size=(4, 93))
    both = [diff.copy() for diff in layer.backward(dy)]
    unwritten = 77
    for wanted in ([True, False], [False, True], [False, False]):
        for blob in layer.bottom:
            blob.diff[...] = unwritten
        for diff, expected, is_wanted in zip(layer.backward(dy, wanted=wanted), both, wanted):
            if is_wanted:
                assert np.array_equal(diff, expected)
            else:
                assert (diff == unwritten).all()


def test_one_size_is_a_factor_if_the_skeleton_has_one_joint(run, tmp_path):
    path = tmp_path / "stick.prototxt"
    path.write_text('dof { name: "a" } joint { name: "tip" bone { axis: X length: 3 } }')
    assert run(LAYER.format(path), np.zeros((1, 1)), [[2.0]]).y.tolist() == [[6, 0, 0]]


@pytest.mark.parametrize("N", [0, 1, 30])
@pytest.mark.parametrize("sizes", [1, 31])
@pytest.mark.parametrize(("dtype", "tolerance"), [(np.float32, 1e-4), (np.float64, 1e-12)])
def test_inference_and_training_agree_with_the_plain_engine(
    net_of, rng, N, sizes, dtype, tolerance
):
    """Nets with and without a backward pass, for any batch size, including 0."""
    layers = f"""
        layer {{ name: "x" type: "Input" top: "x" input_param {{ shape {{ dim: {N} dim: 47 }} }} }}
        layer {{ name: "b" type: "Input" top: "b" input_param {{ shape {{ dim: {N} dim: {sizes} }} }} }}
        layer {{ name: "h" type: "HandModel" bottom: "x" bottom: "b" top: "y" }}
    """
    trainable = "force_backward: true" + layers
    x = rng.normal(0, 0.5, (N, 47))
    b = rng.uniform(0.5, 1.5, (N, sizes))
    dy = rng.normal(size=(N, 93))
    plain = net_of(trainable, engine="plain", dtype=np.float64)
    expected = plain.forward(x=x, b=b)["y"]
    expected_diffs = plain.backward(y=dy)

    inference, training = net_of(layers, dtype=dtype), net_of(trainable, dtype=dtype)
    for net in (inference, training):
        y = net.forward(x=x, b=b)["y"]
        assert y.shape == (N, 93)
        assert np.allclose(y, expected, rtol=0, atol=tolerance)
    for name, diff in training.backward(y=dy).items():
        assert diff.shape == expected_diffs[name].shape
        assert np.allclose(diff, expected_diffs[name], rtol=0, atol=tolerance)


def test_the_skeleton_is_relative_to_the_net(tmp_path, monkeypatch, arm_text):
    """The path is that from the net's file, not from the working directory."""
    (tmp_path / "arm.prototxt").write_text(arm_text)
    layer = f'layer {{ name: "h" bottom: "x" top: "y" {LAYER.format("arm.prototxt")} }}'
    (tmp_path / "net.prototxt").write_text(inputs(x=(1, 4)) + layer)
    for folder in ("/", tmp_path):
        monkeypatch.chdir(folder)
        assert netlib.Net(tmp_path / "net.prototxt").forward()["y"].shape == (1, 9)


@bad_inputs(
    netlib.LayerError,
    {
        "five inputs": (
            np.zeros((2, 5)),
            "...: error: layer 'it': bottom 'bottom0' has shape (2, 5), skeleton 'arm' expects (2, 4)",
        ),
        "a number": (
            np.zeros(()),
            "<gradcheck>:1:1: error: layer 'it': bottom 'bottom0' has shape (), skeleton 'arm' expects (1, 4)",
        ),
    },
)
def test_inputs_of_another_shape_are_rejected(run, arm_layer, given, rejected):
    with rejected:
        run(arm_layer, given)


@pytest.mark.parametrize("shape", [(2, 2), (3, 1), ()])
def test_sizes_of_another_shape_are_rejected(run, arm_layer, shape):
    message = (
        f"<gradcheck>:1:1: error: layer 'it': bottom 'bottom1' has shape {shape}, expected (2, 1), "
        "a factor, or (2, 3), the bone lengths of skeleton 'arm'"
    )
    with pytest.raises(netlib.LayerError, match=f"^{re.escape(message)}$"):
        run(arm_layer, np.zeros((2, 4)), np.zeros(shape))


def test_a_missing_skeleton_is_rejected(run):
    message = r"gone\.prototxt: cannot read the prototxt: No such file or directory$"
    with pytest.raises(netlib.NetlibError, match=message):
        run(LAYER.format("gone.prototxt"), np.zeros((2, 4)))
