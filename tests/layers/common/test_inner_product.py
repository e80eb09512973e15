"""InnerProduct."""

import numpy as np
import pytest

import netlib


def text(options=""):
    fillers = 'weight_filler { type: "gaussian" } bias_filler { type: "gaussian" }'
    return f'type: "InnerProduct" inner_product_param {{ num_output: 3 {fillers} {options} }}'


def test_a_transposed_weight(run, rng):
    x, w = rng.normal(size=(2, 4)), rng.normal(size=(3, 4))
    plain = run(text("bias_term: false"), x, params=[w])
    turned = run(text("bias_term: false transpose: true"), x, params=[w.T])
    assert np.allclose(plain.y, turned.y)
    dy = rng.normal(size=(2, 3))
    assert np.allclose(plain.backward(dy)[0], turned.backward(dy)[0])
    assert np.allclose(plain.layer.blobs[0].diff, turned.layer.blobs[0].diff.T)


@pytest.mark.parametrize(
    ("axis", "shape", "weight"),
    [(1, (2, 3), (3, 20)), (2, (2, 4, 3), (3, 5)), (0, (3,), (3, 40)), (-1, (2, 4, 3), (3, 5))],
)
def test_axes_before_axis_count_items(run, rng, axis, shape, weight):
    x = rng.normal(size=(2, 4, 5))
    done = run(text(f"axis: {axis}"), x)
    assert done.layer.blobs[0].shape == weight
    assert done.y.shape == shape
    w, b = (p.data for p in done.layer.blobs)
    items = x.reshape(-1, weight[1])
    assert np.allclose(done.y.reshape(-1, 3), items @ w.T + b)


def test_more_rows_than_a_block(run, rng, keep_threads):
    """Products are split into blocks between threads; the result is the same for any
    number of threads.
    """
    x = rng.normal(size=(300, 7))
    w = rng.normal(size=(300, 7))
    dy = rng.normal(size=(300, 300))
    layer = text("bias_term: false").replace("num_output: 3", "num_output: 300")
    found = []
    for threads in (1, 3):
        netlib.set_threads(threads)
        done = run(layer, x, params=[w])
        [dx] = done.backward(dy)
        assert np.allclose(done.y, x @ w.T)
        assert np.allclose(dx, dy @ w)
        assert np.allclose(done.layer.blobs[0].diff, dy.T @ x)
        found.append([done.y, dx, done.layer.blobs[0].diff])
    assert all(np.array_equal(a, b) for a, b in zip(*found))


def test_the_gradient_of_a_bias_over_many_items_in_float32(run):
    """The bias gradient has float32 precision; adding 200,000 rows one by one would have an
    error of 2e-3.
    """
    done = run(text(), np.zeros((200_000, 1)), dtype=np.float32)
    dy = np.full((200_000, 3), 0.1, np.float32)
    done.backward(dy)
    assert np.allclose(done.layer.blobs[1].diff, dy.sum(axis=0, dtype=np.float64), rtol=1e-7)
