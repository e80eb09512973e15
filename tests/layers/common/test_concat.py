"""Concat."""

import numpy as np
import pytest

pytestmark = pytest.mark.both_engines


@pytest.mark.parametrize("axis", [0, 1, 2, -1])
def test_one_after_the_other(run, rng, axis):
    """Bottoms are concatenated along any axis; the gradient is split the same way."""
    a, b, c = (rng.normal(size=(2, 3, 4)) for _ in range(3))
    done = run(f'type: "Concat" concat_param {{ axis: {axis} }}', a, b, c)
    assert np.array_equal(done.y, np.concatenate([a, b, c], axis))
    dy = rng.normal(size=done.y.shape)
    for part, want in zip(done.backward(dy), np.split(dy, 3, axis)):
        assert np.array_equal(part, want)


def test_sizes_may_differ_along_the_axis(run):
    """Sizes may differ along the axis, which may be set by its older name concat_dim."""
    done = run('type: "Concat" concat_param { concat_dim: 1 }', [[1], [2]], [[3, 4], [5, 6]])
    assert done.y.tolist() == [[1, 3, 4], [2, 5, 6]]


def test_one_bottom(run, check, rng):
    """A single bottom is copied to the top."""
    x = rng.normal(size=(2, 3))
    assert np.array_equal(run('type: "Concat"', x).y, x)
    check('type: "Concat"', x)


def test_an_empty_bottom(run):
    assert run('type: "Concat"', np.ones((2, 3)), np.ones((2, 0))).y.shape == (2, 3)
