"""Pooling and SPP: any window compared with loops, and Caffe's rules."""

import math

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from tests.layers.conftest import Run
from tests.support.nets import inputs
from tests.support.plain_loops import outputs, pool


def text(**options):
    fields = " ".join(f"{name}: {value}" for name, value in options.items())
    return f'type: "Pooling" pooling_param {{ {fields} }}'


LOWEST = -float(np.finfo(np.float32).max)


def test_the_maximum_of_an_empty_window_is_the_lowest_number(by_hand):
    """Its mask is -1, as in Caffe."""
    tops = [[[[[1], [1], [LOWEST]]]], [[[[0], [3], [-1]]]]]
    by_hand("Pooling pooling_param { kernel_size: 1 stride: 3 }", [np.ones((1, 1, 6, 1))], tops)


@pytest.mark.parametrize(
    ("options", "size", "top"),
    [
        ({"kernel_h": 2, "kernel_w": 1, "stride_h": 2, "stride_w": 3}, (6, 6), (3, 3)),
        # padding on one axis drops an empty last window on the other, as in Caffe: of columns 0, 3
        # and 6 the last
        (
            {"kernel_h": 2, "kernel_w": 1, "stride_h": 2, "stride_w": 3, "pad_h": 1, "pad_w": 0},
            (6, 6),
            (4, 2),
        ),
    ],
    ids=str,
)
def test_output_sizes(run, options, size, top):
    assert run(text(**options), np.zeros((1, 1, *size))).y.shape[2:] == top


SIZES = st.tuples(st.integers(1, 9), st.integers(1, 9))
PAIRS = st.tuples(st.integers(1, 4), st.integers(1, 4))


@given(
    size=SIZES,
    kernel=PAIRS,
    stride=PAIRS,
    pad=st.tuples(st.integers(0, 2), st.integers(0, 2)),
    ceil=st.booleans(),
    mean=st.booleans(),
    ties=st.booleans(),
)
def test_any_window_gives_what_plain_loops_give(size, kernel, stride, pad, ceil, mean, ties):
    stride = tuple(min(s, k) for s, k in zip(stride, kernel))
    assume(all(p < k for p, k in zip(pad, kernel)))
    counts = [outputs(*axis, ceil) for axis in zip(size, kernel, stride, pad)]
    assume(min(counts) > 0)
    x = np.random.default_rng(0).normal(size=(2, 2, *size))
    if ties:
        x = np.rint(x)
    options = {"pool": "AVE" if mean else "MAX", "round_mode": "CEIL" if ceil else "FLOOR"}
    for name, pair in (("kernel", kernel), ("stride", stride), ("pad", pad)):
        options[f"{name}_h"], options[f"{name}_w"] = pair
    compare(text(**options), x, *pool(x, kernel, stride, pad, mean, ceil))


def compare(options, x, y, share):
    """Compare value and gradient of a layer with the definition."""
    done = Run(options, [x])
    assert done.y.shape == y.shape
    assert np.allclose(done.y, y)
    dy = np.random.default_rng(1).normal(size=y.shape)
    done.bottom[0].diff[...] = np.nan
    assert np.allclose(done.backward(dy)[0], np.einsum("ncpq,ncpqhw->nchw", dy, share))


def test_global_pooling_follows_the_size(run, rng):
    done = run(text(global_pooling="true"), rng.normal(size=(2, 3, 4, 5)))
    assert np.allclose(done.y[..., 0, 0], done.bottom[0].data.max(axis=(2, 3)))
    done.bottom[0].reshape(2, 3, 7, 2)
    done.bottom[0].data[...] = rng.normal(size=(2, 3, 7, 2))
    done.layer.reshape(done.bottom, done.top)
    done.layer.forward(done.bottom, done.top)
    assert np.allclose(done.y[..., 0, 0], done.bottom[0].data.max(axis=(2, 3)))


@pytest.mark.parametrize(
    "options",
    [
        {"kernel_size": 2, "stride": 2},
        {"kernel_size": 3, "stride": 2, "pad": 1},
        {"global_pooling": "true"},
        {"kernel_h": 2, "kernel_w": 3, "pad_h": 1, "pad_w": 2},
        {"kernel_size": 7, "stride": 3},
    ],
    ids=str,
)
def test_the_mask_says_where_the_maximum_is(run, rng, options):
    x = rng.normal(size=(2, 3, 5, 6))
    y, mask = (top.reshape(2, 3, -1) for top in run(text(**options), x, tops=2).ys)
    named = np.take_along_axis(x.reshape(2, 3, -1), mask.astype(int), axis=2)
    assert np.array_equal(named, y)


def test_a_layer_in_place_before_the_pooling_shows_in_the_mask(net_of, rng):
    """After a ReLU in place the mask of an all-negative window is its first zero, not the largest
    previous value.
    """
    kernel = 'type: "Convolution" convolution_param { num_output: 1 kernel_size: 1 weight_filler { value: 1 } }'
    pooling = text(kernel_size=2, stride=2)
    net = net_of(
        inputs(x=(2, 1, 6, 6)) + f'layer {{ name: "c" bottom: "x" top: "c" {kernel} }} '
        'layer { name: "r" type: "ReLU" bottom: "c" top: "c" } '
        f'layer {{ name: "p" bottom: "c" top: "y" top: "mask" {pooling} }} '
        f'layer {{ name: "z" bottom: "y" top: "z" {kernel} }} '
    )
    found = net.forward(x=-rng.uniform(1, 2, (2, 1, 6, 6)))["mask"]
    assert found[0, 0].tolist() == [[0, 2, 4], [12, 14, 16], [24, 26, 28]]


@pytest.mark.parametrize(
    "options", [{"kernel_size": 2, "stride": 2}, {"kernel_size": 3, "stride": 2}], ids=str
)
def test_nan_is_propagated(run, options):
    """The solver can detect it."""
    x = np.zeros((1, 1, 4, 4))
    x[0, 0, 1, 1] = np.nan
    done = run(text(**options), x)
    assert np.isnan(done.y[0, 0, 0, 0])
    done.backward(np.ones(done.y.shape))


def test_half_a_kernel_is_ignored_as_in_caffe(run, caplog):
    """Of kernel_size and only one of kernel_h and kernel_w, Caffe uses the former; here
    with a warning.
    """
    done = run(text(kernel_size=2, kernel_h=4), np.zeros((1, 1, 5, 5)))
    assert done.y.shape == (1, 1, 4, 4)
    assert (
        "Pooling ignores kernel_h in pooling_param, as Caffe does; kernel_size takes precedence"
        in caplog.text
    )


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


def spp(height, pool="MAX"):
    return f'type: "SPP" spp_param {{ pyramid_height: {height} pool: {pool} }}'


def test_spp_by_hand(run):
    """The outputs are the whole map, then its quarters, channel by channel within each level."""
    x = np.array([[1.0, 2, 3, 4], [5, 6, 7, 8]]).reshape(1, 1, 2, 4)
    x = np.concatenate([x, 10 * x], axis=1)
    assert run(spp(2), x).y.tolist() == [[8, 80, 2, 4, 6, 8, 20, 40, 60, 80]]
    done = run(spp(2, "AVE"), x[:, :1])
    assert done.y.tolist() == [[4.5, 1.5, 3.5, 5.5, 7.5]]
    (dx,) = done.backward([[8, 2, 0, 0, 4]])
    assert dx[0, 0].tolist() == [[2, 2, 1, 1], [1, 1, 3, 3]]


def test_spp_of_a_single_level_keeps_four_axes(run):
    """A single level keeps four axes, as in Caffe; several levels are flattened."""
    assert run(spp(1), np.ones((2, 3, 4, 5))).y.shape == (2, 3, 1, 1)
    windows = 1 + 4 + 16
    assert run(spp(3), np.ones((2, 3, 4, 4))).y.shape == (2, 3 * windows)


def pooled(run, x, level, pool):
    """Compute a level as a Pooling layer with the window and padding of Caffe's SPP layer."""
    options = f"pool: {pool}"
    for side, size in zip("hw", x.shape[2:]):
        k = math.ceil(size / 2**level)
        pad = (k * 2**level - size + 1) // 2
        options += f" kernel_{side}: {k} stride_{side}: {k} pad_{side}: {pad}"
    return run(f'type: "Pooling" pooling_param {{ {options} }}', x)


@pytest.mark.parametrize("pool", ["MAX", "AVE"])
@pytest.mark.parametrize("size", [(4, 8), (7, 11), (13, 6), (10, 10)], ids=str)
def test_levels_of_spp_are_poolings(run, rng, size, pool):
    """Values and gradients of each level equal those of Pooling, also with windows that extend
    over the edges.
    """
    x = rng.integers(0, 5, (2, 3, *size)).astype(float)
    done = run(spp(3, pool), x)
    levels = [pooled(run, x, level, pool) for level in range(3)]
    assert np.allclose(done.y, np.concatenate([level.y.reshape(2, -1) for level in levels], axis=1))
    dy = rng.normal(size=done.y.shape)
    ends = np.cumsum([level.y[0].size for level in levels])[:-1]
    parts = [part.reshape(level.y.shape) for part, level in zip(np.split(dy, ends, axis=1), levels)]
    dx = sum(level.backward(part)[0] for part, level in zip(parts, levels))
    assert np.allclose(done.backward(dy)[0], dx)
