"""Dividing a batch into slices and lanes, and the blobs of a slice."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

import netlib
from fast import division
from fast.slices import SlicedStep
from tests.support.nets import inputs
from tests.support.sliced_nets import PAPER

MakeNet = Callable[..., netlib.Net]
pytestmark = pytest.mark.usefixtures("slices_of_any_size")


def test_the_slices_of_a_lane_share_parameter_gradients(
    net_of: MakeNet, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The slices are assigned to the lanes in turn, the larger ones first."""
    monkeypatch.setattr(division, "MAX_SLICE", 3)
    monkeypatch.setattr(division, "LANES", 3)
    net = net_of(PAPER)
    [run] = [step.run for step in net.steps if isinstance(step, SlicedStep)]
    lanes = division.Division(run).lanes(items=10)
    rows = [[(piece.rows.start, piece.rows.stop) for piece in lane] for lane in lanes]
    assert rows == [[(0, 3), (8, 10)], [(3, 6)], [(6, 8)]]
    params = [[piece.connections[0].layer.blobs[0] for piece in lane] for lane in lanes]
    assert params[0][0] is params[0][1]
    whole = run.order[0].layer.blobs[0]
    for [param, *_] in params:
        assert np.shares_memory(param.data, whole.data)
        assert not np.shares_memory(param.diff, whole.diff)


SPLIT = """
    layer { name: "a" type: "Power" bottom: "x" top: "a" power_param { shift: 1 } }
    layer { name: "split" type: "Split" bottom: "a" top: "b" top: "c" }
    %s
    layer { name: "d" type: "Eltwise" bottom: "b" bottom: "c" top: "d" }
"""


@pytest.mark.parametrize("overwritten", [False, True])
def test_tops_of_a_split_share_memory_unless_a_layer_overwrites_it(
    net_of: MakeNet, overwritten: bool
) -> None:
    over = 'layer { name: "over" type: "Exp" bottom: "b" top: "b" }' if overwritten else ""
    text = inputs(x=(1, 4)) + SPLIT % over
    fast, plain = net_of(text, engine="fast"), net_of(text, engine="plain")
    for factor in (1, 2):
        x = factor * np.arange(4.0).reshape(1, 4)
        np.testing.assert_array_equal(fast.forward(x=x)["d"], plain.forward(x=x)["d"])
    a, b, c = (fast.blobs[name].data for name in "abc")
    assert np.shares_memory(a, b) == (not overwritten)
    assert np.shares_memory(a, c)
    for net in (fast, plain):  # also of a part
        net.forward(start="d")
        shares = [np.shares_memory(net.blobs["a"].data, net.blobs[name].data) for name in "bc"]
        assert shares == [not overwritten, True]
    np.testing.assert_array_equal(fast.blobs["c"].data, plain.blobs["c"].data)
