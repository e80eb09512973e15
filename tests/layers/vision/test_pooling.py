"""Pooling: any window compared with loops, Caffe's rules, and errors."""

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from netlib import gradcheck
from netlib.blob import Blob, Blobs
from tests.support.nets import inputs
from tests.support.plain_loops import outputs, pool


def text(**options):
    return f'type: "Pooling" pooling_param {{ {" ".join(f"{k}: {v}" for k, v in options.items())} }}'


def test_by_hand(run):
    """With 2 x 2 windows on 3 x 3 pixels the last windows extend over the edge."""
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
)
def test_any_window_gives_what_plain_loops_give(size, kernel, stride, pad, ceil, mean, ties):
    """Values and gradients agree with loops for overlapping, padded and overhanging windows and for ties."""
    stride = tuple(min(s, k) for s, k in zip(stride, kernel))
    assume(all(p < k and outputs(n, k, s, p, ceil) > 0 for n, k, s, p in zip(size, kernel, stride, pad)))
    rng = np.random.default_rng(0)
    x = rng.integers(0, 3, (2, 2, *size)).astype(float) if ties else rng.normal(size=(2, 2, *size))
    options = text(pool="AVE" if mean else "MAX", kernel_h=kernel[0], kernel_w=kernel[1], stride_h=stride[0],
                   stride_w=stride[1], pad_h=pad[0], pad_w=pad[1], round_mode="CEIL" if ceil else "FLOOR")
    compare(options, x, *pool(x, kernel, stride, pad, mean, ceil))


def compare(options, x, y, share):
    """Compare value and gradient of a layer with the definition."""
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


def test_global_pooling_follows_the_size(run, rng):
    """With global_pooling the window has the size of the bottom, even after a change."""
    done = run(text(global_pooling="true"), rng.normal(size=(2, 3, 4, 5)))
    assert np.allclose(done.y[..., 0, 0], done.bottom[0].data.max(axis=(2, 3)))
    done.bottom[0].reshape(2, 3, 7, 2)
    done.bottom[0].data[...] = rng.normal(size=(2, 3, 7, 2))
    done.layer.reshape(done.bottom, done.top)
    done.layer.forward(done.bottom, done.top)
    assert np.allclose(done.y[..., 0, 0], done.bottom[0].data.max(axis=(2, 3)))


def test_output_sizes(run):
    """Sizes are rounded up: 27 gives 14. With padding, a last window that starts in the padding is dropped."""
    assert run(text(kernel_size=2, stride=2), np.zeros((1, 1, 27, 27))).y.shape[2:] == (14, 14)
    assert run(text(kernel_size=2, stride=2, round_mode="FLOOR"), np.zeros((1, 1, 27, 27))).y.shape[2:] == (13, 13)
    assert run(text(kernel_size=2, stride=2, pad=1), np.zeros((1, 1, 4, 5))).y.shape[2:] == (3, 3)
    assert run(text(kernel_size=3), np.zeros((1, 1, 5, 5))).y.shape[2:] == (3, 3)


def test_a_window_larger_than_its_bottom(run):
    """A window may be larger than the bottom if rounding up leaves it; AVE divides by the area within the padding."""
    x = np.array([[1.0, 5], [3, 2]]).reshape(1, 1, 2, 2)
    assert run(text(kernel_size=3, stride=2), x).y.tolist() == [[[[5]]]]
    assert run(text(pool="AVE", kernel_size=3, stride=2), x).y.tolist() == [[[[11 / 4]]]]
    assert run(text(pool="AVE", kernel_size=5, stride=3, pad=1), x).y.tolist() == [[[[11 / 16]]]]


def test_a_window_far_larger_than_its_bottom(run):
    """A huge window takes no memory for its overhang, and the mask is correct."""
    x = np.array([[1.0, 5], [7, 2]]).reshape(1, 1, 2, 2)
    best = run(text(kernel_size=10**9, stride=10**9), x, tops=2)
    assert [y.item() for y in best.ys] == [7, 2]
    assert best.backward([[[[1]]]])[0].tolist() == [[[[0, 0], [1, 0]]]]
    assert run(text(pool="AVE", kernel_size=10**9, stride=10**9), x).y.item() == 15 / 4


def test_a_window_as_large_as_its_bottom_that_begins_in_the_padding(run):
    """Such a window reads neither the last row nor the last column."""
    done = run(text(kernel_size=3, stride=5, pad=1), np.arange(9.0).reshape(1, 1, 3, 3))
    assert done.y.tolist() == [[[[4]]]]
    assert done.backward([[[[1]]]])[0][0, 0].tolist() == [[0, 0, 0], [0, 1, 0], [0, 0, 0]]


def test_padding_on_one_axis_drops_empty_windows_on_the_other(run):
    """As in Caffe, padding on one axis drops an empty last window on the other: of columns 0, 3 and 6 the last."""
    options = {"kernel_h": 2, "kernel_w": 1, "stride_h": 2, "stride_w": 3}
    assert run(text(**options), np.ones((1, 1, 6, 6))).y.shape == (1, 1, 3, 3)
    assert run(text(**options, pad_h=1, pad_w=0), np.ones((1, 1, 6, 6))).y.shape == (1, 1, 4, 2)


# ---------------------------------------------------------------------------------------------- the mask


def test_the_mask_by_hand(run):
    """The mask is the index of each maximum within its 3 x 3 map, in row order; the first of equal values counts."""
    x = np.array([[1.0, 2, 0], [4, 3, 5], [6, 6, 7]]).reshape(1, 1, 3, 3)
    done = run(text(kernel_size=2), x, tops=2)
    assert done.ys[0][0, 0].tolist() == [[4, 5], [6, 7]]
    assert done.ys[1][0, 0].tolist() == [[3, 5], [6, 8]]
    with_mask = done.backward([[[[1, 2], [3, 4]]]], np.full((1, 1, 2, 2), 100))[0]
    assert with_mask[0, 0].tolist() == [[0, 0, 0], [1, 0, 2], [3, 0, 4]]


@pytest.mark.parametrize("options", [
    {"kernel_size": 2, "stride": 2}, {"kernel_size": 3, "stride": 2, "pad": 1}, {"global_pooling": "true"},
    {"kernel_h": 2, "kernel_w": 3, "pad_h": 1, "pad_w": 2}, {"kernel_size": 7, "stride": 3},
], ids=str)
def test_the_mask_says_where_the_maximum_is(run, rng, options):
    x = rng.normal(size=(2, 3, 5, 6))
    y, mask = run(text(**options), x, tops=2).ys
    assert np.array_equal(np.take_along_axis(x.reshape(2, 3, -1), mask.reshape(2, 3, -1).astype(int), axis=2),
                          y.reshape(2, 3, -1))


def test_the_mask_of_an_empty_window(run):
    """The mask of an empty window is -1."""
    assert run(text(kernel_size=1, stride=3), np.ones((1, 1, 6, 1)), tops=2).ys[1].ravel().tolist() == [0, 3, -1]


def test_a_layer_in_place_before_the_pooling_shows_in_the_mask(net_of, rng):
    """After a ReLU in place the mask of an all-negative window is its first zero, not the largest previous value."""
    kernel = 'type: "Convolution" convolution_param { num_output: 1 kernel_size: 1 weight_filler { value: 1 } }'
    net = net_of(
        inputs(x=(2, 1, 6, 6)) + f'layer {{ name: "c" bottom: "x" top: "c" {kernel} }} '
        'layer { name: "r" type: "ReLU" bottom: "c" top: "c" } '
        f'layer {{ name: "p" bottom: "c" top: "y" top: "mask" {text(kernel_size=2, stride=2)} }} '
        f'layer {{ name: "z" bottom: "y" top: "z" {kernel} }} '
    )
    found = net.forward(x=-rng.uniform(1, 2, (2, 1, 6, 6)))["mask"]
    assert found[0, 0].tolist() == [[0, 2, 4], [12, 14, 16], [24, 26, 28]]


# ---------------------------------------------------------------------------------------------- edges and mistakes


def test_an_empty_window(run):
    """A window is empty if stride > kernel; MAX gives -FLT_MAX and AVE gives NaN."""
    x = np.ones((1, 1, 6, 1))
    assert run(text(kernel_h=1, kernel_w=1, stride=3, pad=0), x).y[..., 0].tolist() == [
        [[1, 1, -float(np.finfo(np.float32).max)]]
    ]
    assert np.isnan(run(text(pool="AVE", kernel_h=1, kernel_w=1, stride=3), x).y[0, 0, 2, 0])


@pytest.mark.parametrize("options", [{"kernel_size": 2, "stride": 2}, {"kernel_size": 3, "stride": 2}], ids=str)
def test_nan_is_not_hidden(run, options):
    """A NaN is passed on, so that the solver detects it."""
    x = np.zeros((1, 1, 4, 4))
    x[0, 0, 1, 1] = np.nan
    done = run(text(**options), x)
    assert np.isnan(done.y[0, 0, 0, 0])
    done.backward(np.ones(done.y.shape))


def test_half_a_kernel_is_ignored_as_in_caffe(run, caplog):
    """Of kernel_size and only one of kernel_h and kernel_w, Caffe uses the former; here with a warning."""
    assert run(text(kernel_size=2, kernel_h=4), np.zeros((1, 1, 5, 5))).y.shape == (1, 1, 4, 4)
    assert "Pooling ignores kernel_h in pooling_param, as Caffe does; kernel_size takes precedence" in caplog.text


@pytest.mark.parametrize(("given", "size"), [("true", 4), ("false", 3)])
@pytest.mark.parametrize("pool", ["MAX", "AVE"])
def test_ceil_mode_is_a_rounding(run, rng, given, size, pool):
    """``ceil_mode``, which converters from PyTorch write, is the same as a ``round_mode``."""
    x = rng.normal(size=(2, 3, 8, 8))
    options = {"pool": pool, "kernel_size": 3, "stride": 2}
    done = run(text(**options, ceil_mode=given), x)
    assert done.y.shape == (2, 3, size, size)
    same = run(text(**options, round_mode="CEIL" if given == "true" else "FLOOR"), x)
    assert np.array_equal(done.y, same.y)
    assert np.array_equal(done.backward(done.y)[0], same.backward(same.y)[0])
