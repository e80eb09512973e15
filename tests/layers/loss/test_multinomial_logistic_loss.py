"""MultinomialLogisticLoss."""

import numpy as np
import pytest

TEXT = 'type: "MultinomialLogisticLoss"'


def test_by_hand(run):
    """The loss is -(log 1/2 + log 1/8) / 2; the gradient is -1 / (2 p) times the weight, at the labels only."""
    done = run(TEXT, [[0.25, 0.5, 0.25], [0.125, 0.5, 0.375]], [1, 0])
    assert done.y == pytest.approx(4 * np.log(2) / 2)
    [dp, _] = done.backward(3, wanted=[True, False])
    assert dp.tolist() == [[0, -3, 0], [-12, 0, 0]]


def test_no_logarithm_of_less_than_a_least_probability(run):
    """Probabilities are at least 1e-20, forward and backward."""
    done = run(TEXT, [[0.0, 1]], [0])
    assert done.y == pytest.approx(-np.log(1e-20))
    assert done.backward(1, wanted=[True, False])[0] == pytest.approx(np.array([[-1e20, 0]]))
