"""EuclideanLoss."""

import numpy as np


def test_by_hand(run):
    """The loss is (1 + 4 + 9 + 0) / (2 * 2); the gradient is the difference / N times the loss weight."""
    done = run('type: "EuclideanLoss"', [[1, 2], [3, 4]], [[0, 0], [0, 4]])
    assert done.y == 14 / 4
    da, db = done.backward(3)
    assert da.tolist() == [[1.5, 3], [4.5, 0]]
    assert db.tolist() == (-da).tolist()


def test_only_items_and_values_an_item_must_agree(run):
    """Only the number of items and of values per item must match, such as (2, 3, 2) and (2, 6), as in Caffe."""
    assert run('type: "EuclideanLoss"', np.ones((2, 3, 2)), np.zeros((2, 6))).y == 3
