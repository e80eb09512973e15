"""Reshape."""

import numpy as np
import pytest

import netlib

pytestmark = pytest.mark.both_engines


@pytest.mark.parametrize(
    ("options", "shape"),
    [
        ("shape { dim: 6 dim: 4 }", (6, 4)),
        ("shape { dim: 0 dim: -1 }", (2, 12)),
        ("shape { dim: 0 dim: 0 dim: 2 dim: 2 }", (2, 3, 2, 2)),
        ("shape { dim: -1 }", (24,)),
        ("shape { dim: 12 } axis: 1", (2, 12)),
        ("shape { dim: 3 dim: 1 } axis: 1 num_axes: 1", (2, 3, 1, 4)),
        ("shape { dim: 2 dim: 2 } axis: -2", (2, 3, 2, 2)),
        ("shape { dim: 1 dim: 1 } axis: -1", (2, 3, 4, 1, 1)),
        ("shape { dim: 1 } axis: 0 num_axes: 0", (1, 2, 3, 4)),
        ("shape { } axis: 1 num_axes: 0", (2, 3, 4)),
    ],
)
def test_shapes(run, rng, options, shape):
    """0 copies a size, -1 is inferred, and axis and num_axes select the replaced axes."""
    x = rng.normal(size=(2, 3, 4))
    done = run(f'type: "Reshape" reshape_param {{ {options} }}', x)
    assert np.array_equal(done.y, x.reshape(shape))
    dy = rng.normal(size=shape)
    assert np.array_equal(done.backward(dy)[0], dy.reshape(x.shape))


def test_gradient(check, rng):
    """The gradient agrees with differences."""
    check('type: "Reshape" reshape_param { shape { dim: -1 dim: 2 } }', rng.normal(size=(2, 3, 2)))


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ("shape { dim: 5 }", r"cannot give 24 values \(2, 3, 4\) the shape \(5,\)"),
        ("shape { dim: 5 dim: -1 }", "cannot give 24 values"),
        ("shape { dim: -1 dim: -1 }", "may contain one -1"),
        ("shape { dim: -2 }", "and no smaller number"),
        ("shape { dim: 1 dim: 1 dim: 1 dim: 0 }", "0 at index 3, but the bottom has shape"),
        ("axis: 4", "axis 4, num_axes -1 do not fit a bottom of shape"),
        ("axis: 1 num_axes: 3", "axis 1, num_axes 3 do not fit"),
        ("shape { dim: 24 } num_axes: -2", "axis 0, num_axes -2 do not fit"),
    ],
)
def test_mistakes(run, options, message):
    """The error states the old shape and the invalid option."""
    with pytest.raises(netlib.LayerError, match=message):
        run(f'type: "Reshape" reshape_param {{ {options} }}', np.zeros((2, 3, 4)))
