"""Pooling: any window against plain loops, the tiled way against the same loops, Caffe's rules, mistakes."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import netlib
from netlib import gradcheck
from netlib.blob import Blob, Blobs, plain_of, tiles_of


def text(**options):
    """The layer with these options."""
    return f'type: "Pooling" pooling_param {{ {" ".join(f"{k}: {v}" for k, v in options.items())} }}'


def outputs(size, kernel, stride, pad, ceil=True):
    """Number of windows along one axis."""
    extent = size + 2 * pad - kernel
    count = (-(-extent // stride) if ceil else extent // stride) + 1
    return count - 1 if pad and (count - 1) * stride >= size + pad else count


def plain(x, kernel, stride, pad, mean=False, ceil=True):
    """The definition: for each output its value, and which inputs have which part of it, as (y, weights)."""
    H, W = x.shape[2:]
    Ho, Wo = (outputs(n, k, s, p, ceil) for n, k, s, p in zip((H, W), kernel, stride, pad))
    y, share = np.zeros((*x.shape[:2], Ho, Wo)), np.zeros((*x.shape[:2], Ho, Wo, H, W))
    for n, c, h, w in np.ndindex(y.shape):
        starts = h * stride[0] - pad[0], w * stride[1] - pad[1]
        ends = [min(start + k, size + p) for start, k, size, p in zip(starts, kernel, (H, W), pad)]
        area = (ends[0] - starts[0]) * (ends[1] - starts[1])
        rows = slice(max(starts[0], 0), min(ends[0], H))
        columns = slice(max(starts[1], 0), min(ends[1], W))
        window = x[n, c, rows, columns]
        if mean:
            y[n, c, h, w] = window.sum() / area
            share[n, c, h, w, rows, columns] = 1 / area
        else:
            y[n, c, h, w] = window.max()
            i, j = np.unravel_index(window.argmax(), window.shape)  # the first of equal ones
            share[n, c, h, w, rows.start + i, columns.start + j] = 1
    return y, share


def test_by_hand(run):
    """2 x 2 windows on 3 x 3: the last ones hang over the edge."""
    x = np.array([[1.0, 2, 0], [4, 3, 5], [6, 0, 7]]).reshape(1, 1, 3, 3)
    best = run(text(kernel_size=2, stride=2), x)
    assert best.y[0, 0].tolist() == [[4, 5], [6, 7]]
    assert best.backward([[[[1, 2], [3, 4]]]])[0][0, 0].tolist() == [[0, 0, 0], [1, 0, 2], [3, 0, 4]]
    mean = run(text(pool="AVE", kernel_size=2, stride=2), x)
    assert mean.y[0, 0].tolist() == [[2.5, 2.5], [3, 7]]
    assert mean.backward([[[[4, 2], [6, 1]]]])[0][0, 0].tolist() == [[1, 1, 1], [1, 1, 1], [3, 3, 1]]


SIZES = st.tuples(st.integers(1, 9), st.integers(1, 9))
PAIRS = st.tuples(st.integers(1, 4), st.integers(1, 4))


@given(
    size=SIZES, kernel=PAIRS, stride=PAIRS, pad=st.tuples(st.integers(0, 2), st.integers(0, 2)), ceil=st.booleans(),
    mean=st.booleans(), ties=st.booleans(),
)  # fmt: skip
def test_any_window_gives_what_plain_loops_give(size, kernel, stride, pad, ceil, mean, ties):
    """Overlapping, padded, hanging over, with equal values; forward and backward."""
    stride = tuple(min(s, k) for s, k in zip(stride, kernel))
    if any(p >= k or n + 2 * p < k for n, k, p in zip(size, kernel, pad)):
        return
    rng = np.random.default_rng(0)
    x = rng.integers(0, 3, (2, 2, *size)).astype(float) if ties else rng.normal(size=(2, 2, *size))
    options = text(pool="AVE" if mean else "MAX", kernel_h=kernel[0], kernel_w=kernel[1], stride_h=stride[0],
                   stride_w=stride[1], pad_h=pad[0], pad_w=pad[1], round_mode="CEIL" if ceil else "FLOOR")  # fmt: skip
    compare(options, x, *plain(x, kernel, stride, pad, mean, ceil))


def compare(options, x, y, share, bottom_tile=None, top_tile=None):
    """Value and gradient of a layer with the definition's."""
    layer = gradcheck.make_layer(options, [x])
    bottom, top = Blobs([Blob(x.shape, np.float64)]), Blobs([Blob(y.shape, np.float64)])
    if bottom_tile:
        bottom[0].tile, bottom[0].pitch = bottom_tile, -(-x.shape[3] // bottom_tile) * bottom_tile
    top[0].tile = top_tile
    layer.reshape(bottom, top)
    store(bottom[0], bottom[0].data, x)
    layer.forward(bottom, top)
    assert np.allclose(plain_of(top[0], top[0].data), y)
    dy = np.random.default_rng(1).normal(size=y.shape)
    store(top[0], top[0].diff, dy)
    bottom[0].diff[...] = np.nan
    layer.backward(top, [True], bottom)
    assert np.allclose(plain_of(bottom[0], bottom[0].diff), np.einsum("ncpq,ncpqhw->nchw", dy, share))


def store(blob, array, values):
    """Write values in the order that the blob has."""
    if blob.tile is None:
        array[...] = values
    else:
        tiles_of(Blob(blob.shape, np.float64), values, blob.tile, blob.pitch, array)


@pytest.mark.parametrize("N", range(1, 10))
@pytest.mark.parametrize("T", [2, 3, 4])
def test_tiled_pooling_of_any_number_of_images(rng, N, T):
    """13 x 11, which no T divides; rounded so that there are equal values."""
    x = np.round(rng.normal(size=(N, 2, 13, 11)))
    for top_tile in (None, 1, 2, 4):
        compare(text(kernel_size=T, stride=T), x, *plain(x, (T, T), (T, T), (0, 0)), T, top_tile)


@pytest.mark.parametrize("size", [(4, 4), (5, 9), (8, 6), (4, 17), (7, 7)])
@pytest.mark.parametrize("tiled_bottom", [False, True])
@pytest.mark.parametrize("T", [2, 4])
def test_tiled_pooling_of_any_size(rng, size, tiled_bottom, T):
    """From a plain bottom or one in tiles of the same size."""
    x = rng.normal(size=(3, 2, *size))
    for top_tile in (None, 1, 2):
        compare(
            text(kernel_size=T, stride=T), x, *plain(x, (T, T), (T, T), (0, 0)), T if tiled_bottom else None, top_tile
        )


@pytest.mark.parametrize("pool", ["MAX", "AVE"])
@pytest.mark.parametrize(
    "options",
    [{"kernel_size": 2, "stride": 2}, {"kernel_size": 3, "stride": 2, "pad": 1}, {"global_pooling": "true"}],
    ids=str,
)
def test_gradient(check, rng, pool, options):
    """Of values that are not equal."""
    check(text(pool=pool, **options), rng.permutation(100).reshape(2, 2, 5, 5) / 10)


def test_global_pooling_follows_the_size(run, rng):
    """One window, whatever comes."""
    done = run(text(global_pooling="true"), rng.normal(size=(2, 3, 4, 5)))
    assert np.allclose(done.y[..., 0, 0], done.bottom[0].data.max(axis=(2, 3)))
    done.bottom[0].reshape(2, 3, 7, 2)
    done.bottom[0].data[...] = rng.normal(size=(2, 3, 7, 2))
    done.layer.reshape(done.bottom, done.top)
    done.layer.forward(done.bottom, done.top)
    assert np.allclose(done.y[..., 0, 0], done.bottom[0].data.max(axis=(2, 3)))


def test_output_sizes(run):
    """Rounded up: 27 gives 14; a last window that starts in the padding is dropped, without padding it is not."""
    assert run(text(kernel_size=2, stride=2), np.zeros((1, 1, 27, 27))).y.shape[2:] == (14, 14)
    assert run(text(kernel_size=2, stride=2, round_mode="FLOOR"), np.zeros((1, 1, 27, 27))).y.shape[2:] == (13, 13)
    assert run(text(kernel_size=2, stride=2, pad=1), np.zeros((1, 1, 4, 5))).y.shape[2:] == (3, 3)
    assert run(text(kernel_size=3), np.zeros((1, 1, 5, 5))).y.shape[2:] == (3, 3)


def test_an_empty_window(run):
    """stride > kernel: -FLT_MAX, or 0 / 0."""
    x = np.ones((1, 1, 6, 1))
    assert run(text(kernel_h=1, kernel_w=1, stride=3, pad=0), x).y[..., 0].tolist() == [
        [[1, 1, -float(np.finfo(np.float32).max)]]
    ]
    assert np.isnan(run(text(pool="AVE", kernel_h=1, kernel_w=1, stride=3), x).y[0, 0, 2, 0])


@pytest.mark.parametrize("options", [{"kernel_size": 2, "stride": 2}, {"kernel_size": 3, "stride": 2}], ids=str)
def test_nan_is_not_hidden(run, options):
    """The solver must see it."""
    x = np.zeros((1, 1, 4, 4))
    x[0, 0, 1, 1] = np.nan
    done = run(text(**options), x)
    assert np.isnan(done.y[0, 0, 0, 0])
    done.backward(np.ones(done.y.shape))


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({}, "needs kernel_size, or kernel_h and kernel_w"),
        ({"kernel_h": 2}, "needs kernel_size, or kernel_h and kernel_w"),
        ({"kernel_size": 2, "stride": 0}, "stride must be at least 1"),
        ({"kernel_size": 2, "pad": 2}, r"pad \(2, 2\) must be smaller than the kernel \(2, 2\)"),
        ({"kernel_size": 2, "global_pooling": "true"}, "global_pooling takes no kernel size"),
        ({"global_pooling": "true", "pad": 1}, "global_pooling needs pad 0 and stride 1"),
        ({"pool": "STOCHASTIC", "kernel_size": 2}, "STOCHASTIC pooling is not supported; expected MAX or AVE"),
        ({"kernel_size": 6}, "kernel 6 is larger than the padded bottom"),
        ({"kernel_size": 2, "kernel_h": 3}, "give either kernel_size, or kernel_h and kernel_w"),
        ({"kernel_size": 3, "stride": 2, "stride_h": 1}, "give either stride, or stride_h and stride_w"),
    ],
    ids=str,
)
def test_mistakes(run, options, message):
    """Options that cannot be."""
    with pytest.raises(netlib.LayerError, match=f"layer 'it': {message}"):
        run(text(**options), np.zeros((1, 1, 5, 5)))


def test_a_bottom_that_is_no_image(run):
    """Names the blob and its shape."""
    with pytest.raises(netlib.LayerError, match=r"bottom 'bottom0' has shape \(3, 5\), expected \(N, C, H, W\)"):
        run(text(kernel_size=2), np.zeros((3, 5)))
