"""Silence."""

import numpy as np
import pytest

pytestmark = pytest.mark.both_engines


def test_it_reads_and_gives_no_gradient(run):
    """Every element of the bottom diffs is set to 0."""
    done = run('type: "Silence"', np.ones(3), np.ones((2, 2)), tops=0)
    done.bottom[0].diff[...] = np.nan
    assert [dx.tolist() for dx in done.backward()] == [[0, 0, 0], [[0, 0], [0, 0]]]


def test_what_it_reads_is_no_output(net_of):
    """A blob read by Silence is not an output of the net."""
    text = 'layer { name: "x" type: "Input" top: "x" top: "y" input_param { shape { dim: 2 } } } '
    assert net_of(text).outputs == ["x", "y"]
    assert net_of(text + 'layer { name: "s" type: "Silence" bottom: "x" }').outputs == ["y"]
