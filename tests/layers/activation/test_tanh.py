"""TanH."""

import numpy as np
import pytest

pytestmark = pytest.mark.both_engines


@pytest.mark.parametrize("in_place", [False, True])
def test_by_hand(run, in_place):
    """The values agree at three points where they are simple numbers."""
    done = run('type: "TanH"', [0, np.log(2), -np.log(2)], in_place=in_place)
    assert np.allclose(done.y, [0, 0.6, -0.6])
    assert np.allclose(done.backward([1, 1, 1])[0], [1, 0.64, 0.64])


def test_far_out(run):
    """Far from 0 there is no overflow, and the gradient is 0."""
    done = run('type: "TanH"', [1000.0, -1000.0])
    assert done.y.tolist() == [1, -1]
    assert done.backward([1, 1])[0].tolist() == [0, 0]


@pytest.mark.parametrize("in_place", [False, True])
def test_gradient(check, rng, in_place):
    """The gradient agrees with differences."""
    check('type: "TanH"', rng.normal(size=(3, 4)), in_place=in_place)
