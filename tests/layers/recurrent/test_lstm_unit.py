"""LSTMUnit: its gates, its cell and its gradient, worked by hand and compared with LSTM."""

import math

import pytest

TEXT = 'type: "LSTMUnit"'
LN3 = math.log(3)  # sigmoid(ln 3) = 3/4, tanh(ln 3) = 4/5


def test_by_hand(run):
    """For i = f = 3/4, o = 1/2 and g = 4/5, c = 3/4 * 2 + 3/4 * 4/5 and h = tanh(c) / 2."""
    done = run(TEXT, [[[2]]], [[[LN3, LN3, 0, LN3]]], [[1]], tops=2)
    c, h = done.ys
    assert c.shape == h.shape == (1, 1, 1)
    assert c.item() == pytest.approx(2.1)
    assert h.item() == pytest.approx(math.tanh(2.1) / 2)


def test_gradient_by_hand(run):
    """For the same numbers, dc = 1 and dh = 0 give the gradients of the cell and of each gate."""
    done = run(TEXT, [[[2]]], [[[LN3, LN3, 0, LN3]]], [[1]], tops=2)
    dc_before, dx, _ = done.backward([[[1]]], [[[0]]], wanted=[True, True, False])
    assert dc_before.item() == pytest.approx(3 / 4)
    di, df, do, dg = 4 / 5 * 3 / 16, 2 * 3 / 16, 0, 3 / 4 * 9 / 25
    assert dx.ravel() == pytest.approx([di, df, do, dg])


def test_a_gradient_of_h_reaches_the_output_gate_and_the_cell(run):
    """For dc = 0 and dh = 1 the output gate gets tanh(c) / 4, and the cell (1 - tanh²(c)) / 2 times the forget gate."""
    done = run(TEXT, [[[2]]], [[[LN3, LN3, 0, LN3]]], [[1]], tops=2)
    dc_before, dx, _ = done.backward([[[0]]], [[[1]]], wanted=[True, True, False])
    assert dx[0, 0, 2] == pytest.approx(math.tanh(2.1) / 4)
    assert dc_before.item() == pytest.approx(3 / 4 * (1 - math.tanh(2.1) ** 2) / 2)


def test_a_new_sequence_forgets(run):
    """Where cont is 0 the previous cell is ignored and gets gradient 0."""
    x = [[[LN3, LN3, 0, LN3]] * 2]
    done = run(TEXT, [[[2], [2]]], x, [[0, 1]], tops=2)
    assert done.y.ravel() == pytest.approx([0.6, 2.1])
    dc_before, dx, _ = done.backward([[[1], [1]]], [[[1], [1]]], wanted=[True, True, False])
    assert dc_before[0, 0, 0] == 0
    assert dc_before[0, 1, 0] > 0
    assert dx[0, 0, 1] == 0
    assert dx[0, 1, 1] > 0
