"""Threshold."""

import pytest

from tests.support.nets import inputs

pytestmark = pytest.mark.both_engines


@pytest.mark.parametrize(("options", "y"), [("", [0, 0, 1, 1]), ("threshold: 0.5", [0, 0, 0, 1])])
@pytest.mark.parametrize("in_place", [False, True])
def test_by_hand(run, options, y, in_place):
    """A value equal to the threshold gives 0."""
    assert run(f'type: "Threshold" threshold_param {{ {options} }}', [-1, 0, 0.5, 2], in_place=in_place).y.tolist() == y


def test_it_has_no_gradient(net_of):
    """With force_backward, backward of the layer is not called."""
    net = net_of(
        "force_backward: true " + inputs(x=(2,)) + 'layer { name: "t" type: "Threshold" bottom: "x" top: "y" }'
    )
    net.forward(x=[1.0, -1])
    net.backward()
