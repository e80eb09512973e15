"""LSTMUnit: its gates, its cell and its gradient, worked by hand and compared with LSTM."""

import math

import numpy as np
import pytest

pytestmark = pytest.mark.both_engines

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


def test_gradient(check, rng):
    """The gradients of the cell and of the gates agree with differences, with one of three streams restarting."""
    check(TEXT, rng.normal(size=(1, 3, 2)), rng.normal(size=(1, 3, 8)), [[1, 0, 1]], tops=2, wanted=[True, True, False])


def test_lstm_is_a_row_of_units(run, rng):
    """One step of an LSTM equals a unit that is given its states and the product of its weights."""
    x, h, c, cont = rng.normal(size=(1, 2, 5)), *rng.normal(size=(2, 1, 2, 3)), np.array([[1, 0]])
    options = 'num_output: 3 expose_hidden: true weight_filler { type: "gaussian" } bias_filler { type: "gaussian" }'
    whole = run(f'type: "LSTM" recurrent_param {{ {options} }}', x, cont, h, c, tops=3)
    w_x, b, w_h = (blob.data for blob in whole.layer.blobs)
    z = x @ w_x.T + b + (cont[:, :, None] * h) @ w_h.T
    unit = run(TEXT, c, z, cont, tops=2)
    assert np.allclose(whole.ys[1], unit.ys[1])  # h
    assert np.allclose(whole.ys[2], unit.ys[0])  # c
    dh = rng.normal(size=(1, 2, 3))
    dx = whole.backward(dh, wanted=[True, False, False, False])[0]
    dz = unit.backward(np.zeros((1, 2, 3)), dh, wanted=[True, True, False])[1]
    assert np.allclose(dx, dz @ w_x)


def test_a_gradient_of_the_sequence_marks(run):
    """force_backward does not request a gradient of cont."""
    done = run(TEXT, np.zeros((1, 2, 3)), np.zeros((1, 2, 12)), np.ones((1, 2)), tops=2)
    assert [done.layer.allow_force_backward(i) for i in range(3)] == [True, True, False]
