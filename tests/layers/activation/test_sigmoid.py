"""Sigmoid."""

import numpy as np
import pytest

pytestmark = pytest.mark.both_engines


@pytest.mark.parametrize("in_place", [False, True])
def test_by_hand(run, in_place):
    """The values agree at three points where they are simple numbers."""
    done = run('type: "Sigmoid"', [0, np.log(4), -np.log(4)], in_place=in_place)
    assert np.allclose(done.y, [0.5, 0.8, 0.2])
    assert np.allclose(done.backward([1, 1, 1])[0], [0.25, 0.16, 0.16])


def test_far_out(run):
    """Far from 0 there is no overflow, and the gradient is 0."""
    done = run('type: "Sigmoid"', [1000.0, -1000.0])
    assert done.y.tolist() == [1, 0]
    assert done.backward([1, 1])[0].tolist() == [0, 0]


@pytest.mark.parametrize("in_place", [False, True])
def test_gradient(check, rng, in_place):
    """The gradient agrees with differences."""
    check('type: "Sigmoid"', rng.normal(size=(3, 4)), in_place=in_place)
