"""The slices of a batch, and the lanes to which they are assigned."""

from __future__ import annotations

from collections.abc import Callable

import pytest

import netlib
from fast import division
from fast.slices import SlicedStep
from tests.support.sliced_nets import PAPER


def test_slices_are_assigned_to_lanes_in_turn(
    net_of: Callable[..., netlib.Net], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The larger ones come first."""
    monkeypatch.setattr(division, "MAX_SLICE", 3)
    monkeypatch.setattr(division, "LANES", 3)
    [run] = [step.run for step in net_of(PAPER).steps if isinstance(step, SlicedStep)]
    lanes = division.Division(run).lanes(items=10)
    assert [[piece.rows.start for piece in lane] for lane in lanes] == [[0, 8], [3], [6]]
