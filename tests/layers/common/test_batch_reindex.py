"""BatchReindex."""

import numpy as np
import pytest

pytestmark = pytest.mark.both_engines

X = [[1.0, 2], [3, 4], [5, 6]]


def test_by_hand(run):
    """Items may be selected in any order and repeatedly; the gradients of repeated items are added."""
    done = run('type: "BatchReindex"', X, [2, 0, 2, 0])
    assert done.y.tolist() == [[5, 6], [1, 2], [5, 6], [1, 2]]
    dx, _ = done.backward([[1, 2], [3, 4], [10, 20], [30, 40]], wanted=[True, False])
    assert dx.tolist() == [[33, 44], [0, 0], [11, 22]]


def test_more_axes_and_no_items(run, rng):
    """The list determines the number of items, which may be 0; fractions are truncated, as in Caffe."""
    x = rng.normal(size=(3, 2, 4))
    assert np.array_equal(run('type: "BatchReindex"', x, [1.75]).y, x[1:2])
    assert run('type: "BatchReindex"', x, []).y.shape == (0, 2, 4)


def test_gradient(check, rng):
    """The gradient of the items agrees with differences; the list has none."""
    check('type: "BatchReindex"', rng.normal(size=(4, 3)), [3, 1, 1, 0, 3], wanted=[True, False])


def test_force_backward_does_not_ask_for_the_lists_gradient(net_of):
    """With force_backward only the items have a gradient."""
    net = net_of(
        'force_backward: true layer { name: "in" type: "Input" top: "x" top: "i" '
        "input_param { shape { dim: 3 dim: 2 } shape { dim: 2 } } } "
        'layer { name: "r" type: "BatchReindex" bottom: "x" bottom: "i" top: "y" }'
    )
    net.forward(x=np.array(X), i=np.array([1, 1]))
    assert net.backward(y=np.ones((2, 2)))["x"].tolist() == [[0, 0], [2, 2], [0, 0]]
