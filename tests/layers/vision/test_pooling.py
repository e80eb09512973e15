"""Pooling: any window against plain loops, Caffe's rules, mistakes."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from plain_loops import pool

import netlib
from netlib import gradcheck
from netlib.blob import Blob, Blobs


def text(**options):
    """The layer with these options."""
    return f'type: "Pooling" pooling_param {{ {" ".join(f"{k}: {v}" for k, v in options.items())} }}'


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
    compare(options, x, *pool(x, kernel, stride, pad, mean, ceil))


def compare(options, x, y, share):
    """Value and gradient of a layer with the definition's."""
    layer = gradcheck.make_layer(options, [x])
    bottom, top = Blobs([Blob(x.shape, np.float64)]), Blobs([Blob(y.shape, np.float64)])
    layer.reshape(bottom, top)
    bottom[0].data[...] = x
    layer.forward(bottom, top)
    assert np.allclose(top[0].data, y)
    dy = np.random.default_rng(1).normal(size=y.shape)
    top[0].diff[...], bottom[0].diff[...] = dy, np.nan
    layer.backward(top, [True], bottom)
    assert np.allclose(bottom[0].diff, np.einsum("ncpq,ncpqhw->nchw", dy, share))


@pytest.mark.parametrize("kind", ["MAX", "AVE"])
@pytest.mark.parametrize(
    "options",
    [{"kernel_size": 2, "stride": 2}, {"kernel_size": 3, "stride": 2, "pad": 1}, {"global_pooling": "true"}],
    ids=str,
)
def test_gradient(check, rng, kind, options):
    """Of values that are not equal."""
    check(text(pool=kind, **options), rng.permutation(100).reshape(2, 2, 5, 5) / 10)


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
