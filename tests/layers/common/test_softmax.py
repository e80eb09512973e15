"""Softmax."""

import numpy as np


def test_by_hand(run):
    """The values are exp(0), exp(log 2) and exp(log 5), divided by their sum 8."""
    x = [[0, np.log(2), np.log(5)]]
    done = run('type: "Softmax"', x)
    assert np.allclose(done.y, [[1 / 8, 2 / 8, 5 / 8]])
    # y (dy - <y, dy>) with dy = (8, 0, 0): <y, dy> = 1
    assert np.allclose(done.backward([[8, 0, 0]])[0], [[7 / 8, -2 / 8, -5 / 8]])


def test_large_scores(run):
    """The maximum is subtracted first, so large scores do not overflow."""
    assert run('type: "Softmax"', [[1e4, 0, -1e4]]).y.tolist() == [[1, 0, 0]]
