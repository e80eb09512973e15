"""Scale."""

import numpy as np
import pytest


def text(options=""):
    return f'type: "Scale" scale_param {{ filler {{ type: "gaussian" }} bias_filler {{ type: "gaussian" }} {options} }}'


def test_by_hand(run):
    """Each channel has one gain and one bias."""
    done = run(text("bias_term: true"), [[1, 2], [3, 4]], params=[[2, 10], [1, 0]])
    assert done.y.tolist() == [[3, 20], [7, 40]]
    [dx] = done.backward([[1, 1], [1, 0]])
    assert dx.tolist() == [[2, 10], [2, 0]]
    assert done.layer.blobs[0].diff.tolist() == [4, 2]
    assert done.layer.blobs[1].diff.tolist() == [2, 1]


def test_it_starts_as_the_identity(run, rng):
    """The initial gain is 1 and the initial bias is 0."""
    x = rng.normal(size=(2, 3))
    assert np.array_equal(run('type: "Scale" scale_param { bias_term: true }', x).y, x)


@pytest.mark.parametrize(
    ("options", "shape"),
    [("", (3,)), ("axis: 0", (2,)), ("axis: 1 num_axes: 2", (3, 4)), ("axis: 0 num_axes: -1", (2, 3, 4)),
     ("num_axes: 0", ()), ("axis: -1", (4,))],
)
@pytest.mark.parametrize("in_place", [False, True])
def test_gradient_for_every_shape_of_the_gain(run, check, rng, options, shape, in_place):
    """The gradients of x, gain and bias agree with differences, also in place."""
    x = rng.normal(size=(2, 3, 4))
    assert run(text(options), x).layer.blobs[0].shape == shape
    check(text(options + " bias_term: true"), x, in_place=in_place)


@pytest.mark.parametrize("in_place", [False, True])
def test_a_second_bottom_as_gain(run, check, rng, in_place):
    """The second bottom replaces the gain parameter; the bias is optional, and both bottoms have gradients."""
    x, gain = rng.normal(size=(2, 3, 4)), rng.normal(size=3)
    assert np.allclose(run('type: "Scale"', x, gain).y, x * gain[:, None])
    check(text("bias_term: true"), x, gain, in_place=in_place)
    check(text(), x, rng.normal(size=()), in_place=in_place)


def test_a_gain_of_no_axes_fits_anywhere(run):
    """With num_axes 0 or a scalar bottom the axis is ignored."""
    assert run(text("num_axes: 0 axis: 5"), [2.0, 3], params=[2]).y.tolist() == [4, 6]
    assert run(text("axis: 5"), [2.0, 3], 2.0).y.tolist() == [4, 6]


def test_num_axes_counts_only_for_a_gain_of_its_own(run, rng):
    """num_axes is ignored if a second bottom is the gain, as in Caffe."""
    x, gain = rng.normal(size=(2, 3, 4)), rng.normal(size=(3, 4))
    assert np.array_equal(run(text("num_axes: 9"), x, gain).y, x * gain)
