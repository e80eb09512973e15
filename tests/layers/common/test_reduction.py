"""Reduction."""

import numpy as np
import pytest

X = [[1.0, -2, 3], [0, 4, -5]]


def text(options=""):
    return f'type: "Reduction" reduction_param {{ {options} }}'


@pytest.mark.parametrize(("options", "y", "dx"), [
    ("", 1, [[10, 10, 10], [10, 10, 10]]),
    ("operation: ASUM", 15, [[10, -10, 10], [0, 10, -10]]),  # the gradient at 0 is 0
    ("operation: SUMSQ coeff: 0.5", 27.5, [[10, -20, 30], [0, 40, -50]]),
    ("operation: MEAN coeff: 3", 0.5, [[5, 5, 5], [5, 5, 5]]),
    ("operation: 4 coeff: 3", 0.5, [[5, 5, 5], [5, 5, 5]]),  # MEAN; the enum starts at 1 in caffe.proto
])
def test_by_hand(run, options, y, dx):
    """The whole bottom is reduced to a scalar; the gradients agree for dy = 10."""
    done = run(text(options), X)
    assert done.y.shape == ()
    assert done.y == pytest.approx(y)
    assert np.allclose(done.backward(10)[0], dx)


@pytest.mark.parametrize(
    ("options", "y"),
    [("axis: 1", [2, -1]), ("operation: MEAN axis: -1", [2 / 3, -1 / 3]), ("operation: SUMSQ axis: 1", [14, 41]),
     ("operation: ASUM axis: 1 coeff: -1", [-6, -9])],
)
def test_from_an_axis_on(run, options, y):
    """The axes before ``axis`` are kept."""
    assert np.allclose(run(text(options), X).y, y)
    assert run(text(options.replace("1", "2", 1)), np.ones((2, 3, 4, 5))).y.shape in [(2, 3), (2, 3, 4)]
