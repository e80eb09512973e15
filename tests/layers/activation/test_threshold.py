"""Threshold."""

import pytest

import netlib
from tests.support.nets import inputs

pytestmark = pytest.mark.both_engines


@pytest.mark.parametrize(("options", "y"), [("", [0, 0, 1, 1]), ("threshold: 0.5", [0, 0, 0, 1])])
@pytest.mark.parametrize("in_place", [False, True])
def test_by_hand(run, options, y, in_place):
    """The threshold itself is not above it."""
    assert run(f'type: "Threshold" threshold_param {{ {options} }}', [-1, 0, 0.5, 2], in_place=in_place).y.tolist() == y


def test_it_has_no_gradient(run, net_of):
    """And says so when it is asked for one; force_backward does not ask."""
    with pytest.raises(netlib.LayerError, match="has no gradient"):
        run('type: "Threshold"', [1.0]).backward([1])
    net = net_of(
        "force_backward: true " + inputs(x=(2,)) + 'layer { name: "t" type: "Threshold" bottom: "x" top: "y" }'
    )
    net.forward(x=[1.0, -1])
    net.backward()
