"""RNN, LSTM and LSTMUnit: by hand, compared with loops, and their state between batches."""

import math

import numpy as np
import pytest
from scipy.special import expit

from netlib.snapshots.snapshot import as_plain

CONT = np.array([[0, 1], [1, 1], [1, 0], [1, 1]])
kinds = pytest.mark.parametrize("kind", ["RNN", "LSTM"])


def text(kind="RNN", outputs=3, options=""):
    fillers = 'weight_filler { type: "gaussian" } bias_filler { type: "gaussian" }'
    return f'type: "{kind}" recurrent_param {{ num_output: {outputs} {fillers} {options} }}'


def test_an_rnn_by_hand(run):
    """With one output, h = tanh(x + 2 h before + 0.5) and o = tanh(3 h - 1)."""
    params = [[1]], [0.5], [[2]], [[3]], [-1]
    done = run(text(outputs=1), [[[0.1]], [[-0.2]]], [[1], [1]], params=params)
    h1 = np.tanh(0.1 + 0.5)
    h2 = np.tanh(-0.2 + 2 * h1 + 0.5)
    assert np.allclose(done.y.ravel(), np.tanh([3 * h1 - 1, 3 * h2 - 1]))


C1 = np.tanh(1) / 2


@pytest.mark.parametrize(
    ("shut", "second", "cells"),
    [
        (None, 2, [C1, (C1 + np.tanh(2)) / 2]),  # all gates at 1/2: c = (c before + tanh(x)) / 2
        (0, 1, [0, 0]),
        (1, 1, [C1, C1]),
        (2, 1, [0, 0]),  # a closed input, forget and output gate
    ],
    ids=["open", "input", "forget", "output"],
)
def test_an_lstm_by_hand(run, shut, second, cells):
    """h = tanh(c) / 2; the rows of the weights are input, forget, output gate and proposal."""
    bias = np.zeros(4)
    bias[[shut] if shut is not None else []] = -1000
    params = [[[0], [0], [0], [1]], bias, np.zeros((4, 1))]
    done = run(text("LSTM", 1), [[[1]], [[second]]], [[1], [1]], params=params)
    assert np.allclose(done.y.ravel(), np.tanh(cells) / 2)


def loops(kind, x, cont, params, static=None, h=None, c=None):
    """Compute the definition stream by stream and step by step; returns y and the last states."""
    w_x, b, *w_s, w_h = params if kind == "LSTM" else params[:-2]
    D = w_h.shape[1]
    y = np.zeros((*x.shape[:2], D))
    last = np.zeros((2, x.shape[1], D))
    for n in range(x.shape[1]):
        h_n, c_n = (np.zeros(D) if state is None else state[n] for state in (h, c))
        for t in range(len(x)):
            h_n = cont[t, n] * h_n
            a = w_x @ x[t, n].ravel() + b + w_h @ h_n
            if static is not None:
                a = a + w_s[0] @ static[n].ravel()
            if kind == "LSTM":
                i, f, o, g = a.reshape(4, D)
                c_n = cont[t, n] * c_n
                c_n = expit(f) * c_n + expit(i) * np.tanh(g)
                h_n = y[t, n] = expit(o) * np.tanh(c_n)
            else:
                h_n = np.tanh(a)
                y[t, n] = np.tanh(params[-2] @ h_n + params[-1])
        last[:, n] = h_n, c_n
    return y, *last[: 2 if kind == "LSTM" else 1]


@pytest.mark.parametrize("item", [(5,), (2, 3)], ids=str)
@pytest.mark.parametrize("with_static", [False, True])
@kinds
def test_it_gives_what_plain_loops_give(run, rng, kind, item, with_static):
    """The outputs agree with loops for features of several axes and static features, and the
    state carries over.
    """
    x, static = rng.normal(size=(4, 2, *item)), rng.normal(size=(2, 2, 2)) if with_static else None
    done = run(text(kind), x, CONT, *[static] * with_static)
    params = [blob.data for blob in done.layer.blobs]
    rows, more = (12, []) if kind == "LSTM" else (3, [(3, 3), (3,)])
    of_static = [(rows, 4)] * with_static
    shapes = [(rows, x[0, 0].size), (rows,), *of_static, (rows, 3), *more]
    assert [p.shape for p in params] == shapes
    y, *states = loops(kind, x, CONT, params, static)
    assert np.allclose(done.y, y)
    done.layer.forward(done.bottom, done.top)
    assert np.allclose(done.y, loops(kind, x, CONT, params, static, *states)[0])


def test_the_exposed_state_of_an_rnn(run, rng):
    """The exposed state h is the bottom after the static features, and the second top; its
    gradient is 0.
    """
    x = rng.normal(size=(4, 2, 5))
    static = rng.normal(size=(2, 4))
    h = rng.normal(size=(1, 2, 3))
    done = run(text(options="expose_hidden: true"), x, np.ones((4, 2)), static, h, tops=2)
    params = [blob.data for blob in done.layer.blobs]
    y, last = loops("RNN", x, np.ones((4, 2)), params, static, h[0])
    assert np.allclose(done.ys[0], y)
    assert np.allclose(done.ys[1][0], last)
    dy = np.ones((4, 2, 3)), np.ones((1, 2, 3))
    assert not done.backward(*dy, wanted=[True, False, True, True])[3].any()


def test_the_exposed_states_of_an_lstm(run, rng):
    """They are h and c; two halves with passed states equal the whole sequence."""
    x = rng.normal(size=(4, 2, 5))
    h = rng.normal(size=(1, 2, 3))
    c = rng.normal(size=(1, 2, 3))
    exposed = text("LSTM", options="expose_hidden: true")
    whole = run(exposed, x, np.ones((4, 2)), h, c, tops=3)
    params = [blob.data for blob in whole.layer.blobs]
    wanted = loops("LSTM", x, np.ones((4, 2)), params, None, h[0], c[0])
    assert all(np.allclose(a, b) for a, b in zip(whole.ys, wanted))
    states, parts = (h, c), []
    for half in (x[:2], x[2:]):
        done = run(exposed, half, np.ones((2, 2)), *states, tops=3, params=params)
        parts.append(done.ys[0])
        states = done.ys[1:]
    assert np.allclose(np.concatenate(parts), whole.y)
    assert all(np.allclose(a, b) for a, b in zip(states, whole.ys[1:]))


def test_no_gradient_passes_exposed_states(run, rng):
    """Exposed states have gradient 0, and the gradients of their tops are ignored, as in Caffe."""
    x, states = rng.normal(size=(3, 2, 5)), rng.normal(size=(2, 1, 2, 3))
    done = run(text("LSTM", options="expose_hidden: true"), x, np.ones((3, 2)), *states, tops=3)
    wanted, dy = [True, False, True, True], rng.normal(size=(3, 2, 3))
    dx, _, dh, dc = done.backward(dy, *np.zeros((2, 1, 2, 3)), wanted=wanted)
    assert dx.all()
    assert not dh.any()
    assert not dc.any()
    before = dx.copy()
    assert np.array_equal(done.backward(dy, *np.ones((2, 1, 2, 3)), wanted=wanted)[0], before)


@kinds
def test_a_new_sequence_forgets_the_old_one(run, rng, kind):
    """Where cont is 0 the state of that stream, and only of that stream, is reset."""
    x = rng.normal(size=(4, 2, 5))
    done = run(text(kind), x, CONT)
    params = [blob.data for blob in done.layer.blobs]
    alone = run(text(kind), x[2:, 1:], [[0], [1]], params=params)
    assert np.allclose(done.y[2:, 1:], alone.y)
    done.layer.forward(done.bottom, done.top)
    assert np.allclose(done.y[:, 0], run(text(kind), x, CONT, params=params).y[:, 0])


@kinds
def test_a_resume_goes_on_exactly(net_of, rng, kind):
    shapes = "shape { dim: 3 dim: 2 dim: 4 } shape { dim: 3 dim: 2 }"
    prototxt = (
        f'layer {{ name: "in" type: "Input" top: "x" top: "cont" input_param {{ {shapes} }} }}'
        f'layer {{ name: "r" bottom: "x" bottom: "cont" top: "y" {text(kind)} }}'
    )
    inputs = {"x": rng.normal(size=(3, 2, 4)), "cont": np.ones((3, 2))}
    net, other = net_of(prototxt), net_of(prototxt)
    net.forward(**inputs)
    other.restore_layer_states(as_plain(net.layer_states()))
    ours, theirs = net.forward(**inputs)["y"].copy(), other.forward(**inputs)["y"].copy()
    assert np.array_equal(ours, theirs)
    assert not np.array_equal(ours, net_of(prototxt).forward(**inputs)["y"])


@kinds
def test_another_number_of_streams(run, rng, kind):
    """With fewer streams the first ones continue; with more, all start at zero."""
    x, ones = rng.normal(size=(3, 2, 5)), np.ones((3, 3))
    whole = run(text(kind), x, ones[:, :2])
    params = [blob.data.copy() for blob in whole.layer.blobs]
    fresh = run(text(kind), np.repeat(x[:, :1], 3, axis=1), ones, params=params).y
    whole.layer.forward(whole.bottom, whole.top)
    second = whole.y.copy()

    first = run(text(kind), x, ones[:, :2], params=params)
    assert np.allclose(follow(first, x[:, :1], ones[:, :1]), second[:, :1])
    assert np.allclose(follow(first, np.repeat(x[:, :1], 3, axis=1), ones), fresh)


def follow(done, x, cont):
    """Run the next batch of a layer with another number of streams."""
    for blob, array in zip(done.bottom, (x, cont)):
        blob.reshape(array.shape)
        blob.data[...] = array
    done.layer.reshape(done.bottom, done.top)
    done.layer.forward(done.bottom, done.top)
    return done.y


LN3, TANH = math.log(3), math.tanh(2.1)  # sigmoid(ln 3) = 3/4, tanh(ln 3) = 4/5


@pytest.mark.parametrize(
    ("dc", "dh", "of_cell", "of_output"), [(1, 0, 1, 0), (0, 1, (1 - TANH**2) / 2, TANH / 4)]
)
def test_an_lstm_unit_by_hand(by_hand, dc, dh, of_cell, of_output):
    """For i = f = 3/4, o = 1/2 and g = 4/5, c = 3/4 * 2 + 3/4 * 4/5 = 2.1 and h = tanh(c) / 2."""
    dx = [of_cell * 3 / 20, of_cell * 3 / 8, of_output, of_cell * 27 / 100]
    bottoms = [[[2]]], [[[LN3, LN3, 0, LN3]]], [[1]]
    tops, dy = ([[[2.1]]], [[[TANH / 2]]]), ([[[dc]]], [[[dh]]])
    by_hand("LSTMUnit", bottoms, tops, dy, [[[[of_cell * 3 / 4]]], [[dx]], None])


def test_an_lstm_unit_forgets_where_a_sequence_is_new(run):
    """The previous cell is ignored and gets gradient 0."""
    gates = [[LN3, LN3, 0, LN3]] * 2
    done = run('type: "LSTMUnit"', [[[2], [2]]], [gates], [[0, 1]], tops=2)
    assert done.y.ravel() == pytest.approx([0.6, 2.1])
    dc_before, dx, _ = done.backward([[[1], [1]]], [[[1], [1]]], wanted=[True, True, False])
    assert dc_before[0, 0, 0] == dx[0, 0, 1] == 0
    assert dc_before[0, 1, 0] > 0
    assert dx[0, 1, 1] > 0
