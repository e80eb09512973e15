"""Bias."""

import numpy as np
import pytest


def text(options=""):
    return f'type: "Bias" bias_param {{ filler {{ type: "gaussian" }} {options} }}'


def test_by_hand(run):
    """Each channel has one bias."""
    done = run(text(), [[1, 2], [3, 4]], params=[[10, 20]])
    assert done.y.tolist() == [[11, 22], [13, 24]]
    assert done.backward([[1, 2], [3, 5]])[0].tolist() == [[1, 2], [3, 5]]
    assert done.layer.blobs[0].diff.tolist() == [4, 7]


def test_it_starts_as_the_identity(run, rng):
    """The initial bias is 0."""
    x = rng.normal(size=(2, 3))
    assert np.array_equal(run('type: "Bias"', x).y, x)


@pytest.mark.parametrize(
    ("options", "shape"),
    [("", (3,)), ("axis: 0", (2,)), ("num_axes: 2", (3, 4)), ("axis: 0 num_axes: -1", (2, 3, 4)), ("num_axes: 0", ()),
     ("axis: -1", (4,))],
)
@pytest.mark.parametrize("in_place", [False, True])
def test_gradient_for_every_shape_of_the_bias(run, check, rng, options, shape, in_place):
    x = rng.normal(size=(2, 3, 4))
    assert run(text(options), x).layer.blobs[0].shape == shape
    check(text(options), x, in_place=in_place)


@pytest.mark.parametrize("in_place", [False, True])
def test_a_second_bottom_as_bias(run, check, rng, in_place):
    """The second bottom replaces the parameter and num_axes; the gradients of both, and of each alone, agree."""
    x, b = rng.normal(size=(2, 3, 4)), rng.normal(size=(3, 4))
    done = run(text("num_axes: 7"), x, b)
    assert np.allclose(done.y, x + b)
    assert not done.layer.blobs
    for bias in (b, rng.normal(size=()), rng.normal(size=3)):
        check(text(), x, bias, in_place=in_place)
    check(text(), x, b, wanted=[False, True])
    check(text(), x, b, wanted=[True, False])
