"""Upsample with a mask."""

import numpy as np
import pytest

import netlib
from tests.support.nets import inputs

pytestmark = pytest.mark.both_engines


def text(**options):
    """Return a layer with these options."""
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


@pytest.mark.parametrize(
    ("options", "size"),
    [
        ({}, (4, 6)),
        ({"scale": 3}, (6, 9)),
        ({"scale_h": 2, "scale_w": 5}, (4, 15)),
        ({"scale": 2, "pad_out_h": "true"}, (3, 6)),
        ({"scale": 2, "pad_out_h": "true", "pad_out_w": "true"}, (3, 5)),
        ({"upsample_h": 5, "upsample_w": 7}, (5, 7)),
        ({"scale": 2, "upsample_h": 5, "upsample_w": 7}, (5, 7)),
    ],
    ids=str,
)
def test_sizes(run, options, size):
    """The size is a multiple of that of the bottom, or the one given."""
    assert run(text(**options), np.zeros((2, 1, 2, 3)), np.zeros((2, 1, 2, 3))).y.shape == (2, 1, *size)


def test_the_size_follows_the_bottom(run, rng):
    """A bottom of another size gives a top of another size."""
    done = run(text(scale=2), X, MASK)
    for blob in done.bottom:
        blob.reshape(2, 3, 1, 4)
        blob.data[...] = 0
    done.layer.reshape(done.bottom, done.top)
    done.layer.forward(done.bottom, done.top)
    assert done.y.shape == (2, 3, 2, 8)


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


def test_gradient(check, rng):
    """The gradient agrees with differences, also where values are replaced."""
    mask = rng.integers(0, 20, (2, 3, 2, 2))
    check(text(upsample_h=4, upsample_w=5), rng.normal(size=(2, 3, 2, 2)), mask, wanted=[True, False])


def test_no_items(run):
    """A batch without items is computed."""
    assert run(text(), np.zeros((0, 3, 2, 2)), np.zeros((0, 3, 2, 2))).y.shape == (0, 3, 4, 4)


@pytest.mark.parametrize(
    ("options", "shapes", "message"),
    [
        ({"scale_h": 2}, [(1, 1, 2, 2)] * 2, "needs scale_h and scale_w"),
        ({"upsample_w": 2}, [(1, 1, 2, 2)] * 2, "needs upsample_h and upsample_w"),
        ({"scale": 2, "scale_h": 2, "scale_w": 2}, [(1, 1, 2, 2)] * 2, "give either scale, or scale_h and scale_w"),
        ({"scale": 1}, [(1, 1, 2, 2)] * 2, "scale must be at least 2"),
        ({"upsample_h": 1, "upsample_w": 4}, [(1, 1, 2, 2)] * 2, "upsample_h and upsample_w must be at least 2"),
        ({"scale": 3, "pad_out_h": "true"}, [(1, 1, 2, 2)] * 2, "pad_out_h is for scale 2, not 3"),
        ({}, [(2, 2, 2)] * 2, r"bottom 'bottom0' has shape \(2, 2, 2\), expected \(N, C, H, W\)"),
        ({}, [(1, 1, 2, 2), (1, 1, 2, 3)], r"'bottom0' \(1, 1, 2, 2\) and 'bottom1' \(1, 1, 2, 3\), the mask of a P"),
    ],
)
def test_mistakes(run, options, shapes, message):
    """Contradictory options and shapes raise an error."""
    with pytest.raises(netlib.LayerError, match=f"layer 'it': .*{message}"):
        run(text(**options), *map(np.zeros, shapes))


@pytest.mark.parametrize("wrong", [-1, 16, np.nan])
def test_a_mask_outside_the_top_is_an_error(run, wrong):
    """The error states the place in the mask and the size that its pooling must have read."""
    mask = MASK.copy()
    mask[0, 0, 1, 0] = wrong
    message = (
        rf"mask 'bottom1' is {wrong} at \(0, 0, 1, 0\), expected 0 to 15 for a top of 4 x 4; its Pooling must read"
    )
    with pytest.raises(netlib.LayerError, match=message):
        run('type: "Upsample"', X, mask)
