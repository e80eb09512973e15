"""LSTM: its gates, its cell and its gradient through time."""

import numpy as np
import pytest
from scipy.special import expit


def text(outputs=3, options=""):
    fillers = 'weight_filler { type: "gaussian" } bias_filler { type: "gaussian" }'
    return f'type: "LSTM" recurrent_param {{ num_output: {outputs} {fillers} {options} }}'


CONT = np.array([[0, 1], [1, 1], [1, 0], [1, 1]])


def test_by_hand(run):
    """With all gates at 1/2 and the proposal tanh(x), c = (c before + tanh(x)) / 2 and h = tanh(c) / 2."""
    w_x = [[0], [0], [0], [1]]
    done = run(text(1), [[[1]], [[2]]], [[1], [1]], params=[w_x, [0] * 4, np.zeros((4, 1))])
    c1 = np.tanh(1) / 2
    c2 = (c1 + np.tanh(2)) / 2
    assert np.allclose(done.y.ravel(), [np.tanh(c1) / 2, np.tanh(c2) / 2])


def test_the_gates_in_their_order(run):
    """The rows of the weights are input, forget, output gate and proposal; a large negative bias closes a gate."""
    w_x, w_h = [[0], [0], [0], [1]], np.zeros((4, 1))

    def outputs(shut):
        bias = np.zeros(4)
        bias[shut] = -1000
        return run(text(1), [[[1]], [[1]]], [[1], [1]], params=[w_x, bias, w_h]).y.ravel()

    c = np.tanh(1) / 2
    assert np.allclose(outputs(0), [0, 0])  # a closed input gate
    assert np.allclose(outputs(1), [np.tanh(c) / 2] * 2)  # a closed forget gate
    assert np.allclose(outputs(2), [0, 0])  # a closed output gate


def loops(x, cont, params, static=None, h=None, c=None):
    """Compute the definition stream by stream and step by step."""
    w_x, b, *w_s, w_h = params
    D = w_h.shape[1]
    y = np.zeros((*x.shape[:2], D))
    last = np.zeros((2, x.shape[1], D))
    for n in range(x.shape[1]):
        h_n, c_n = (np.zeros(D) if state is None else state[n] for state in (h, c))
        for t in range(len(x)):
            h_n, c_n = cont[t, n] * h_n, cont[t, n] * c_n
            a = w_x @ x[t, n].ravel() + b + w_h @ h_n
            if static is not None:
                a = a + w_s[0] @ static[n].ravel()
            i, f, o, g = a.reshape(4, D)
            c_n = expit(f) * c_n + expit(i) * np.tanh(g)
            h_n = y[t, n] = expit(o) * np.tanh(c_n)
        last[:, n] = h_n, c_n
    return y, last[0], last[1]


@pytest.mark.parametrize("item", [(5,), (2, 3)], ids=str)
@pytest.mark.parametrize("with_static", [False, True])
def test_it_gives_what_plain_loops_give(run, rng, item, with_static):
    """The outputs agree with loops for features of several axes and static features, and the state carries over."""
    x, static = rng.normal(size=(4, 2, *item)), rng.normal(size=(2, 2, 2))
    bottoms = [x, CONT] + [static] * with_static
    done = run(text(), *bottoms)
    params = [blob.data for blob in done.layer.blobs]
    assert [p.shape for p in params] == [(12, x[0, 0].size), (12,), *[(12, 4)] * with_static, (12, 3)]
    y, h, c = loops(x, CONT, params, static if with_static else None)
    assert np.allclose(done.y, y)
    done.layer.forward(done.bottom, done.top)
    assert np.allclose(done.y, loops(x, CONT, params, static if with_static else None, h, c)[0])


def test_exposed_states(run, rng):
    """The exposed states are h and c; two halves with passed states equal the whole sequence."""
    x, h, c = rng.normal(size=(4, 2, 5)), rng.normal(size=(1, 2, 3)), rng.normal(size=(1, 2, 3))
    whole = run(text(options="expose_hidden: true"), x, np.ones((4, 2)), h, c, tops=3)
    params = [blob.data for blob in whole.layer.blobs]
    assert all(np.allclose(a, b) for a, b in zip(whole.ys, loops(x, np.ones((4, 2)), params, None, h[0], c[0])))
    states, parts = (h, c), []
    for half in (x[:2], x[2:]):
        done = run(text(options="expose_hidden: true"), half, np.ones((2, 2)), *states, tops=3, params=params)
        parts.append(done.ys[0])
        states = done.ys[1:]
    assert np.allclose(np.concatenate(parts), whole.y)
    assert all(np.allclose(a, b) for a, b in zip(states, whole.ys[1:]))


def test_no_gradient_passes_exposed_states(run, rng):
    """Exposed states have gradient 0, and the gradients of their tops are ignored, as in Caffe."""
    bottoms = rng.normal(size=(3, 2, 5)), np.ones((3, 2)), *rng.normal(size=(2, 1, 2, 3))
    done = run(text(options="expose_hidden: true"), *bottoms, tops=3)
    wanted = [True, False, True, True]
    dy = rng.normal(size=(3, 2, 3))
    dx, _, dh, dc = (
        array.copy() for array in done.backward(dy, np.zeros((1, 2, 3)), np.zeros((1, 2, 3)), wanted=wanted)
    )
    assert dx.all()
    assert not dh.any()
    assert not dc.any()
    assert np.array_equal(done.backward(dy, np.ones((1, 2, 3)), np.ones((1, 2, 3)), wanted=wanted)[0], dx)
