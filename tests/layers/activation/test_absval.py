"""AbsVal."""

import pytest

pytestmark = pytest.mark.both_engines


def test_by_hand(run):
    """The gradient has the sign of x and is 0 at 0."""
    done = run('type: "AbsVal"', [-2, 0, 3])
    assert done.y.tolist() == [2, 0, 3]
    assert done.backward([5, 5, 5])[0].tolist() == [-5, 0, 5]


def test_gradient(check, rng):
    """The gradient agrees with differences away from the kink."""
    check('type: "AbsVal"', rng.choice([-1, 1], (3, 4)) * rng.uniform(0.1, 1, (3, 4)))
