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
