"""HandModel: kinematics as a layer, for the hand and for another body."""

import numpy as np
import pytest

import netlib
from layers.hand.kinematics import Kinematics
from layers.hand.skeleton import load
from tests.support.bad_input import bad_inputs
from tests.support.nets import inputs


@pytest.fixture
def text(tmp_path, arm_text):
    """The layer with the skeleton of the planar arm."""
    (tmp_path / "arm.prototxt").write_text(arm_text)
    return f'type: "HandModel" hand_model_param {{ skeleton: "{tmp_path}/arm.prototxt" }}'


def test_another_body_is_another_file(run, text, arm, rng):
    """A skeleton file defines another body: inputs (N, 4), joints (N, 9)."""
    x = rng.normal(size=(5, 4))
    assert np.allclose(run(text, x).y, arm(x).reshape(5, 9))


@pytest.fixture
def of_any(tmp_path, any_body):
    """The layer with a random body, and its skeleton."""
    (tmp_path / "any.prototxt").write_text(any_body)
    path = tmp_path / "any.prototxt"
    return f'type: "HandModel" hand_model_param {{ skeleton: "{path}" }}', load(path)


@pytest.mark.parametrize("N", [2, 20])
def test_a_factor_is_a_scaled_body(run, of_any, rng, N):
    """A factor per item scales bones and initial translations, including those of fixed DoFs."""
    text, skeleton = of_any
    x, b = rng.normal(size=(N, 6)), rng.normal(size=(N, 1, 1))
    expected = [
        Kinematics(skeleton.scaled(float(s))).joints(row[None]) for row, s in zip(x, b.ravel())
    ]
    assert np.allclose(run(text, x, b).y, np.reshape(expected, (N, 18)))


def test_lengths_are_a_body_with_such_bones(run, of_any, rng):
    """A length per joint replaces its bone, with its sign; lengths of joints without a
    bone are ignored.
    """
    text, skeleton = of_any
    x, b = rng.normal(size=(3, 6)), rng.normal(size=(3, 6))
    assert (skeleton.bone_axes < 0).any()
    dofs = skeleton.param.dof
    expected = [
        Kinematics(skeleton.with_numbers(dofs, own)).joints(row[None]) for row, own in zip(x, b)
    ]
    assert np.allclose(run(text, x, b).y, np.reshape(expected, (3, 18)))


@pytest.mark.parametrize(
    ("N", "size"), [(2, (1,)), (2, (6,)), (2, (1, 1)), (2, (3, 2)), (17, (1,)), (17, (6,))]
)
def test_gradient_of_the_size(check, of_any, rng, N, size):
    check(of_any[0], rng.normal(size=(N, 6)), rng.normal(size=(N, *size)))


@pytest.mark.parametrize("sizes", [1, 31])
def test_each_gradient_is_that_of_both(run, rng, sizes):
    made = run('type: "HandModel"', rng.normal(size=(4, 47)), rng.uniform(0.5, 1.5, (4, sizes)))
    dy = rng.normal(size=(4, 93))
    both = [diff.copy() for diff in made.backward(dy)]
    for wanted in ([True, False], [False, True], [False, False]):
        for blob in made.bottom:
            blob.diff[...] = 77
        found = made.backward(dy, wanted=wanted)
        for diff, expected, asked in zip(found, both, wanted):
            assert np.array_equal(diff, expected if asked else np.full(diff.shape, 77.0))


def test_a_body_of_one_joint_has_a_factor(run, tmp_path):
    (tmp_path / "stick.prototxt").write_text(
        'dof { name: "a" } joint { name: "tip" bone { axis: X length: 3 } }'
    )
    text = f'type: "HandModel" hand_model_param {{ skeleton: "{tmp_path}/stick.prototxt" }}'
    assert run(text, np.zeros((1, 1)), [[2.0]]).y.tolist() == [[6, 0, 0]]


@pytest.mark.parametrize("N", [0, 1, 30])
@pytest.mark.parametrize("sizes", [1, 31])
@pytest.mark.parametrize(("dtype", "tolerance"), [(np.float32, 1e-4), (np.float64, 1e-12)])
def test_a_net_with_sizes(net_of, rng, N, sizes, dtype, tolerance):
    """A net that predicts, a net that learns and the plain engine agree for any batch
    size, including 0.
    """
    layers = f"""
        layer {{ name: "x" type: "Input" top: "x" input_param {{ shape {{ dim: {N} dim: 47 }} }} }}
        layer {{ name: "b" type: "Input" top: "b" input_param {{ shape {{ dim: {N} dim: {sizes} }} }} }}
        layer {{ name: "h" type: "HandModel" bottom: "x" bottom: "b" top: "y" }}
    """
    x = rng.normal(0, 0.5, (N, 47))
    b = rng.uniform(0.5, 1.5, (N, sizes))
    dy = rng.normal(size=(N, 93))
    predicting, learning = (
        net_of(start + layers, dtype=dtype) for start in ("", "force_backward: true")
    )
    plain = net_of("force_backward: true" + layers, engine="plain", dtype=np.float64)
    expected = plain.forward(x=x, b=b)["y"]
    gradients = plain.backward(y=dy)
    for net in (predicting, learning):
        y = net.forward(x=x, b=b)["y"]
        assert y.shape == (N, 93) and np.allclose(y, expected, rtol=0, atol=tolerance)
    for name, found in learning.backward(y=dy).items():
        assert found.shape == gradients[name].shape
        assert np.allclose(found, gradients[name], rtol=0, atol=tolerance)


def test_the_skeleton_is_found_beside_the_net(tmp_path, monkeypatch, arm_text):
    (tmp_path / "arm.prototxt").write_text(arm_text)
    (tmp_path / "net.prototxt").write_text(
        inputs(x=(1, 4))
        + 'layer { name: "h" type: "HandModel" bottom: "x" top: "y" hand_model_param { skeleton: "arm.prototxt" } }'
    )
    for folder in ("/", tmp_path):
        monkeypatch.chdir(folder)
        assert netlib.Net(tmp_path / "net.prototxt").forward()["y"].shape == (1, 9)


LENGTHS = "expected (2, 1), a factor, or (2, 3), the bone lengths of skeleton 'arm'"


@bad_inputs(
    netlib.LayerError,
    {
        **{
            f"sizes of {shape}": (
                [np.zeros((2, 4)), np.zeros(shape)],
                f"<gradcheck>:1:1: error: layer 'it': bottom 'bottom1' has shape {shape}, {LENGTHS}",
            )
            for shape in ((2, 2), (3, 1), ())
        },
        "five inputs": (
            [np.zeros((2, 5))],
            "...: error: layer 'it': bottom 'bottom0' has shape (2, 5), skeleton 'arm' expects (2, 4)",
        ),
        "a number": (
            [np.zeros(())],
            "<gradcheck>:1:1: error: layer 'it': bottom 'bottom0' has shape (), skeleton 'arm' expects (1, 4)",
        ),
        "no file": (
            [],
            netlib.NetlibError,
            "...gone.prototxt: cannot read the prototxt: No such file or directory",
        ),
    },
)
def test_mistakes(run, text, given, rejected):
    with rejected:
        run(
            text if given else text.replace("arm.prototxt", "gone.prototxt"),
            *(given or [np.zeros((2, 4))]),
        )
