"""MVN: normalization of each channel or of each item, with or without the variance."""

import numpy as np

X = np.array([[1.0, 3], [10, 30]]).reshape(1, 2, 1, 2)


def text(options=""):
    return f'type: "MVN" mvn_param {{ {options} }}'


def test_by_hand(run):
    """The channels have means 2 and 20 and standard deviations 1 and 10."""
    assert np.allclose(run(text(), X).y.ravel(), [-1, 1, -1, 1])
    assert run(text("normalize_variance: false"), X).y.ravel().tolist() == [-1, 1, -10, 10]


def test_across_channels(run):
    assert run(text("across_channels: true normalize_variance: false"), X).y.ravel().tolist() == [-10, -8, -1, 19]
    assert np.isclose(run(text("across_channels: true"), X).y.std(), 1)


def test_eps_is_added_to_the_standard_deviation(run):
    """eps is added to the standard deviation: (1 - 2) / (1 + 3); a constant channel gives zeros."""
    assert np.allclose(run(text("eps: 3"), X[:, :1]).y.ravel(), [-0.25, 0.25])
    assert not run(text(), np.full((1, 1, 3, 3), 7.0)).y.any()


def test_the_gradient_is_that_without_eps(run):
    """The gradient ignores eps, as in Caffe, and is exact only for a small eps."""
    done = run(text("eps: 3"), [[[[1.0, 2, 6]]]])
    [dx] = done.backward([[[[1, 0, 0]]]])
    y, s = done.y.ravel(), np.std([1, 2, 6]) + 3
    assert np.allclose(dx.ravel(), (np.array([1, 0, 0]) - 1 / 3 - y * y[0] / 3) / s)


def test_a_top_has_four_axes(run):
    """The top has four axes, as in Caffe: (N, C) becomes (N, C, 1, 1)."""
    assert run(text("across_channels: true"), np.zeros((2, 3))).y.shape == (2, 3, 1, 1)
