"""AbsVal."""

import pytest

import netlib
from tests.support.nets import inputs

pytestmark = pytest.mark.both_engines


def test_by_hand(run):
    """The gradient has the sign of x and is 0 at 0."""
    done = run('type: "AbsVal"', [-2, 0, 3])
    assert done.y.tolist() == [2, 0, 3]
    assert done.backward([5, 5, 5])[0].tolist() == [-5, 0, 5]


def test_gradient(check, rng):
    """The gradient agrees with differences away from the kink."""
    check('type: "AbsVal"', rng.choice([-1, 1], (3, 4)) * rng.uniform(0.1, 1, (3, 4)))


def test_it_cannot_run_in_place(net_of):
    """AbsVal rejects in-place operation, because the sign of x would be lost; Caffe does so too."""
    with pytest.raises(netlib.LayerError, match="AbsVal cannot run in place, but 'x' is both bottom and top"):
        net_of(inputs(x=(2,)) + 'layer { name: "a" type: "AbsVal" bottom: "x" top: "x" }')
