"""What layer types state of their computation, which the fast engine relies on, is true."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from netlib.blob import Blob, Blobs
from netlib.layer import Layer
from tests.support.layer_cases import CASES, cases_in, forward

FOLDER = Path(__file__).parent
BATCHWISE = cases_in(FOLDER / "batchwise.txt")
OF_THE_BATCH = cases_in(FOLDER / "of_the_batch.txt")
ALL = CASES | BATCHWISE | OF_THE_BATCH


def states(name: str, statement: str) -> bool:
    """Whether a layer makes a statement after reshape."""
    arrays = ALL[name].bottoms(2)
    layer = ALL[name].layer(arrays)
    forward(ALL[name], layer, arrays)
    return bool(getattr(layer, statement))


@pytest.mark.parametrize("name", [name for name in ALL if states(name, "batchwise")])
def test_a_batchwise_layer_treats_every_item_alone(name: str) -> None:
    """Item n of a top depends only on item n of the bottoms, as slices require."""
    case = ALL[name]
    arrays = case.bottoms(5)
    layer = case.layer(arrays)
    whole = [blob.data for blob in forward(case, layer, arrays)[1]]
    for i in range(5):
        alone = [blob.data for blob in forward(case, layer, [x[i : i + 1] for x in arrays])[1]]
        assert all(np.allclose(a[0], w[i], rtol=1e-13, atol=1e-13) for a, w in zip(alone, whole))


def test_the_options_decide_which_layers_are_batchwise() -> None:
    assert [name for name in BATCHWISE if not states(name, "batchwise")] == []
    assert [name for name in OF_THE_BATCH if states(name, "batchwise")] == []


@pytest.mark.parametrize("name", [name for name in ALL if states(name, "elementwise")])
def test_an_elementwise_layer_treats_every_value_alone(name: str) -> None:
    """If a bottom value changes, only the top values in its place do; that of 0 is finite."""
    case = ALL[name]
    [x] = case.bottoms(2)
    layer = case.layer([x])
    assert layer.batchwise
    before = [blob.data for blob in forward(case, layer, [x])[1]]
    for place in np.ndindex(x.shape):
        changed = x.copy()
        changed[place] = 0
        for y, old in zip(forward(case, layer, [changed])[1], before):
            assert np.isfinite(y.data[place])
            y.data[place] = old[place]
            assert_array_equal(y.data, old)


def unread(layer: Layer, bottom: Blobs, top: Blobs) -> list[Blob]:
    """The blobs whose data backward does not read."""
    read = [*(bottom if layer.reads_bottom else []), *([] if layer.reads_top is False else top)]
    return [blob for blob in [*bottom, *top] if blob not in read]


def in_place(name: str) -> bool:
    """Whether the layer of an case can run in place."""
    arrays = ALL[name].bottoms(2)
    return ALL[name].layer(arrays).in_place and len(arrays) == ALL[name].tops == 1


@pytest.mark.parametrize(
    ("name", "together"),
    [(name, False) for name in ALL] + [(name, True) for name in ALL if in_place(name)],
)
def test_backward_reads_only_what_it_says(name: str, together: bool) -> None:
    """Data that backward does not read may be overwritten; if it does not read what forward kept,
    a new layer may run it.
    """
    case = ALL[name]
    arrays = case.bottoms(2)
    found = []
    for spoil in (False, True):
        layer = case.layer(arrays)
        bottom, top = forward(case, layer, arrays, together)
        for blob in top:
            blob.diff[...] = np.arange(blob.count).reshape(blob.shape) + 1
        for blob in unread(layer, bottom, top) if spoil else []:
            blob.data[...] = np.nan
        if spoil and not layer.reads_kept:
            layer = case.layer(arrays)
            layer.reshape(bottom, top)
        layer.backward(top, case.wanted, bottom)
        diffs = [blob.diff for blob, want in zip(bottom, case.wanted) if want]
        found.append(diffs + [param.diff for param in layer.blobs])
    for a, b in zip(*found):
        assert_array_equal(a, b)
