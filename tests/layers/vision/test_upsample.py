"""Upsample with a mask."""

import numpy as np
import pytest

from tests.support.nets import inputs


def text(**options):
    return f'type: "Upsample" upsample_param {{ {" ".join(f"{k}: {v}" for k, v in options.items())} }}'


X = np.array([[[[1.0, 2], [3, 4]]]])
MASK = np.array([[[[5.0, 2], [8, 15]]]])  # in a map of 4 x 4


def test_by_hand(run):
    """Each value goes to the pixel that the mask names; other pixels are 0."""
    done = run('type: "Upsample"', X, MASK)
    assert done.y.tolist() == [[[[0, 0, 2, 0], [0, 1, 0, 0], [3, 0, 0, 0], [0, 0, 0, 4]]]]
    dx, dmask = done.backward(10 * np.arange(16.0).reshape(1, 1, 4, 4))
    assert dx.tolist() == [[[[50, 20], [80, 150]]]]
    assert not dmask.any()


def test_the_last_of_several_values_counts(run):
    """Of values with the same place, as overlapping windows have, the last one is kept, and it gets the gradient."""
    done = run('type: "Upsample"', X, [[[[5, 5], [0, 5]]]])
    assert done.y.ravel().tolist() == [3, 0, 0, 0, 0, 4] + [0] * 10
    assert done.backward(np.ones((1, 1, 4, 4)))[0].tolist() == [[[[0, 0], [1, 1]]]]


@pytest.mark.parametrize(("options", "size"), [
    ({}, (4, 6)),
    ({"scale": 3}, (6, 9)),
    ({"scale_h": 2, "scale_w": 5}, (4, 15)),
    ({"scale": 2, "pad_out_h": "true"}, (3, 6)),
    ({"scale": 2, "pad_out_h": "true", "pad_out_w": "true"}, (3, 5)),
    ({"upsample_h": 5, "upsample_w": 7}, (5, 7)),
    ({"scale": 2, "upsample_h": 5, "upsample_w": 7}, (5, 7)),
], ids=str)
def test_sizes(run, options, size):
    """The size is a multiple of that of the bottom, or the one given."""
    assert run(text(**options), np.zeros((2, 1, 2, 3)), np.zeros((2, 1, 2, 3))).y.shape == (2, 1, *size)


@pytest.mark.parametrize("kernel", ["kernel_size: 2 stride: 2", "kernel_size: 3 stride: 2 pad: 1"])
def test_after_a_pooling_with_a_mask(net_of, rng, kernel):
    """A pooling and an upsampling with its mask keep the maxima in place, and pass the gradient to them."""
    x = rng.permutation(2 * 3 * 6 * 6).reshape(2, 3, 6, 6) + 1.0
    net = net_of(
        inputs(x=x.shape)
        + "force_backward: true "
        + f'layer {{ name: "p" type: "Pooling" bottom: "x" top: "p" top: "mask" pooling_param {{ {kernel} }} }}'
        + 'layer { name: "u" bottom: "p" bottom: "mask" top: "y" type: "Upsample" '
        + "upsample_param { upsample_h: 6 upsample_w: 6 } }",
        dtype=np.float64,
    )
    y = net.forward(x=x)["y"].copy()
    assert np.array_equal(y[y > 0], x[y > 0])
    assert set(np.unique(y)) == {0, *np.unique(net.blobs["p"].data)}
    dx = net.backward(y=np.ones_like(y))["x"]
    assert np.array_equal(dx > 0, y > 0)


def test_no_items(run):
    """A batch without items is computed."""
    assert run(text(), np.zeros((0, 3, 2, 2)), np.zeros((0, 3, 2, 2))).y.shape == (0, 3, 4, 4)
