"""RNN: its values and gradient, and behaviour shared with LSTM: sequences, the state between batches, errors."""

import numpy as np
import pytest

from netlib.snapshots.snapshot import as_plain


def text(kind="RNN", outputs=3, options=""):
    fillers = 'weight_filler { type: "gaussian" } bias_filler { type: "gaussian" }'
    return f'type: "{kind}" recurrent_param {{ num_output: {outputs} {fillers} {options} }}'


CONT = np.array([[0, 1], [1, 1], [1, 0], [1, 1]])
both = pytest.mark.parametrize("kind", ["RNN", "LSTM"])


def test_by_hand(run):
    """With one output, h = tanh(x + 2 h before + 0.5) and o = tanh(3 h - 1)."""
    done = run(text(outputs=1), [[[0.1]], [[-0.2]]], [[1], [1]], params=[[[1]], [0.5], [[2]], [[3]], [-1]])
    h1 = np.tanh(0.1 + 0.5)
    h2 = np.tanh(-0.2 + 2 * h1 + 0.5)
    assert np.allclose(done.y.ravel(), [np.tanh(3 * h1 - 1), np.tanh(3 * h2 - 1)])


def loops(x, cont, params, static=None, h=None):
    """Compute the definition stream by stream and step by step."""
    w_x, b, *w_s, w_h, w_o, b_o = params
    D = len(b)
    y, last = np.zeros((*x.shape[:2], D)), np.zeros((x.shape[1], D))
    for n in range(x.shape[1]):
        h_n = np.zeros(D) if h is None else h[n]
        for t in range(len(x)):
            a = w_x @ x[t, n].ravel() + b + w_h @ (cont[t, n] * h_n)
            if static is not None:
                a = a + w_s[0] @ static[n].ravel()
            h_n = np.tanh(a)
            y[t, n] = np.tanh(w_o @ h_n + b_o)
        last[n] = h_n
    return y, last


@pytest.mark.parametrize("item", [(5,), (2, 3)], ids=str)
@pytest.mark.parametrize("with_static", [False, True])
def test_it_gives_what_plain_loops_give(run, rng, item, with_static):
    """The outputs agree with loops for features of several axes and static features, and the state carries over."""
    x, static = rng.normal(size=(4, 2, *item)), rng.normal(size=(2, 2, 2))
    done = run(text(), *[x, CONT], *[static] * with_static)
    params = [blob.data for blob in done.layer.blobs]
    square = (3, 3)
    assert [p.shape for p in params] == [(3, x[0, 0].size), (3,), *[(3, 4)] * with_static, square, square, (3,)]
    y, h = loops(x, CONT, params, static if with_static else None)
    assert np.allclose(done.y, y)
    done.layer.forward(done.bottom, done.top)
    assert np.allclose(done.y, loops(x, CONT, params, static if with_static else None, h)[0])


def test_the_exposed_state(run, rng):
    """The exposed state h is the bottom after the static features, and the second top; its gradient is 0."""
    x, static, h = rng.normal(size=(4, 2, 5)), rng.normal(size=(2, 4)), rng.normal(size=(1, 2, 3))
    done = run(text(options="expose_hidden: true"), x, np.ones((4, 2)), static, h, tops=2)
    params = [blob.data for blob in done.layer.blobs]
    y, last = loops(x, np.ones((4, 2)), params, static, h[0])
    assert np.allclose(done.ys[0], y)
    assert np.allclose(done.ys[1][0], last)
    assert not done.backward(np.ones((4, 2, 3)), np.ones((1, 2, 3)), wanted=[True, False, True, True])[3].any()


# ---------------------------------------------------------------------------------------------- both layers


@both
def test_a_new_sequence_forgets_the_old_one(run, rng, kind):
    """Where cont is 0 the state of that stream, and only of that stream, is reset."""
    x = rng.normal(size=(4, 2, 5))
    done = run(text(kind), x, CONT)
    params = [blob.data for blob in done.layer.blobs]
    alone = run(text(kind), x[2:, 1:], [[0], [1]], params=params)
    assert np.allclose(done.y[2:, 1:], alone.y)
    done.layer.forward(done.bottom, done.top)
    assert np.allclose(done.y[:, 0], run(text(kind), x, CONT, params=params).y[:, 0])


@both
def test_a_resume_goes_on_exactly(net_of, rng, kind):
    """The state survives a snapshot exactly, in the net's float32."""
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


@both
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
