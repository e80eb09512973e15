"""BNLL."""

import numpy as np
import pytest

pytestmark = pytest.mark.both_engines


@pytest.mark.parametrize("in_place", [False, True])
def test_by_hand(run, in_place):
    """The values agree at points where the exponentials are simple numbers."""
    done = run('type: "BNLL"', [0, np.log(3), -np.log(3)], in_place=in_place)
    assert np.allclose(done.y, np.log([2, 4, 4 / 3]))
    assert np.allclose(done.backward([4, 4, 4])[0], [2, 3, 1])


def test_far_out(run):
    """Far from 0 the layer equals a ReLU, without overflow."""
    done = run('type: "BNLL"', [1000.0, -1000.0])
    assert done.y.tolist() == [1000, 0]
    assert done.backward([1, 1])[0].tolist() == [1, 0]


@pytest.mark.parametrize("in_place", [False, True])
def test_gradient(check, rng, in_place):
    """The gradient agrees with differences."""
    check('type: "BNLL"', rng.normal(size=(3, 4)), in_place=in_place)
