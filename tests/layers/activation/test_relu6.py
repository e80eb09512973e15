"""ReLU6."""

import numpy as np
import pytest

from tests.support.nets import inputs

pytestmark = pytest.mark.both_engines

LEAKY = 'type: "ReLU6" relu6_param { negative_slope: 0.25 }'


@pytest.mark.parametrize(
    ("text", "y", "dx"),
    [('type: "ReLU6"', [0, 0, 3, 6, 6], [0, 0, 5, 0, 0]), (LEAKY, [-0.5, 0, 3, 6, 6], [1.25, 1.25, 5, 0, 0])],
)
@pytest.mark.parametrize("in_place", [False, True])
def test_by_hand(run, text, y, dx, in_place):
    """The values agree at -2, 0, 3, 6 and 8; at 0 the gradient is that of the negative side, and at 6 it is 0."""
    done = run(text, [-2, 0, 3, 6, 8], in_place=in_place)
    assert done.y.tolist() == y
    assert done.backward([5] * 5)[0].tolist() == dx


def test_a_steep_negative_side_is_limited_too(run):
    """With a slope below 0, negative values become positive and are limited to 6."""
    done = run('type: "ReLU6" relu6_param { negative_slope: -2 }', [-4, -2, 4, 8])
    assert done.y.tolist() == [6, 4, 4, 6]
    assert done.backward([1] * 4)[0].tolist() == [0, -2, 1, 0]


@pytest.mark.parametrize("shape", [(), (0, 20_000), (3, 5), (2, 1 << 14), (3, (1 << 14) + 5)])
def test_any_size_and_order(run, rng, shape):
    """Long rows, odd sizes and scalars give the same values, although they are computed in different ways."""
    x, dy = rng.normal(3, 5, size=shape), rng.normal(size=shape)
    done = run('type: "ReLU6"', x)
    assert np.array_equal(done.y, np.clip(x, 0, 6))
    assert np.array_equal(done.backward(dy)[0], dy * (x > 0) * (x < 6))


@pytest.mark.parametrize("slope", [0, 0.25, -3])
def test_gradient(check, rng, slope):
    """The gradient agrees with differences away from the kinks."""
    x = rng.choice([-3, -1, 2, 4, 7], (3, 4)) + rng.uniform(0.1, 0.9, (3, 4))
    text = f'type: "ReLU6" relu6_param {{ negative_slope: {slope} }}'
    check(text, x)
    if slope >= 0:
        check(text, x, in_place=True)


def test_before_a_max_pooling_in_place(net_of, rng):
    """Where the fast engine moves it behind a pooling, values and gradients are those of the file's order."""
    x = rng.normal(3, 5, size=(2, 3, 6, 6))
    conv = 'convolution_param { num_output: 4 kernel_size: 3 weight_filler { type: "gaussian" std: 0.5 } }'
    text = (
        inputs(x=x.shape)
        + "force_backward: true "
        + f'layer {{ name: "c" type: "Convolution" bottom: "x" top: "c" {conv} }}'
        + 'layer { name: "r" type: "ReLU6" bottom: "c" top: "c" }'
        + 'layer { name: "p" type: "Pooling" bottom: "c" top: "p" pooling_param { kernel_size: 2 stride: 2 } }'
    )
    net = net_of(text, dtype=np.float64)
    y, dy = net.forward(x=x)["p"].copy(), rng.normal(size=(2, 4, 2, 2))
    dx = net.backward(p=dy)["x"].copy()
    weight = net.params["c"][0].data
    windows = np.lib.stride_tricks.sliding_window_view(x, (3, 3), axis=(2, 3))
    c = np.einsum("nchwij,ocij->nohw", windows, weight)
    tiles = np.clip(c, 0, 6).reshape(2, 4, 2, 2, 2, 2).swapaxes(3, 4).reshape(2, 4, 2, 2, 4)
    assert np.allclose(y, tiles.max(axis=-1))
    places = tiles.argmax(axis=-1)
    inside = (tiles.max(axis=-1) > 0) & (tiles.max(axis=-1) < 6)
    want = np.zeros_like(x)
    for n, o, h, w in np.argwhere(inside):
        i, j = 2 * h + places[n, o, h, w] // 2, 2 * w + places[n, o, h, w] % 2
        want[n, :, i : i + 3, j : j + 3] += dy[n, o, h, w] * weight[o]
    assert np.allclose(dx, want)
