"""Convolution, Deconvolution, depthwise convolutions and Im2col, compared with loops."""

import logging

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.layers.conftest import Run
from tests.support.plain_loops import check_transpose, convolve


def text(kind="Convolution", **options):
    options = options if kind == "ConvolutionDepthwise" else {"num_output": 2, **options}
    fields = " ".join(f"{name}: {value}" for name, value in options.items())
    fillers = 'weight_filler { type: "gaussian" } bias_filler { type: "gaussian" }'
    return f'type: "{kind}" convolution_param {{ {fields} {fillers} }}'


PAIRS = st.tuples(st.integers(1, 3), st.integers(1, 3))


@given(
    N=st.integers(1, 3),
    per=st.integers(1, 2),
    group=st.integers(1, 2),
    size=st.tuples(*[st.integers(1, 9)] * 2),
    kernel=PAIRS,
    stride=PAIRS,
    pad=st.tuples(*[st.integers(0, 2)] * 2),
    dilation=PAIRS,
)
def test_any_options_give_what_plain_loops_give(N, per, group, size, kernel, stride, pad, dilation):
    C = O = per * group
    reach = [d * (k - 1) + 1 for d, k in zip(dilation, kernel)]
    if any(s + 2 * p < r for s, p, r in zip(size, pad, reach)):
        return
    rng = np.random.default_rng(0)
    x = rng.normal(size=(N, C, *size))
    w = rng.normal(size=(O, per, *kernel))
    b = rng.normal(size=O)
    options = {"num_output": O, "group": group, "dilation": f"[{dilation[0]}, {dilation[1]}]"}
    for name, pair in (("kernel", kernel), ("stride", stride), ("pad", pad)):
        options[f"{name}_h"], options[f"{name}_w"] = pair
    done = Run(text(**options), [x], params=[w, b])
    assert np.allclose(done.y, convolve(x, w, b, stride, pad, dilation, group))
    dy = rng.normal(size=done.y.shape)
    done.bottom[0].diff[...] = np.nan
    [dx], (dw, db) = done.backward(dy), (blob.diff for blob in done.layer.blobs)
    check_transpose(
        dy, x, w, b, dx, dw, db, lambda x, w, b: convolve(x, w, b, stride, pad, dilation, group)
    )


SHAPES = [(2, 3), (2, 3, 7), (2, 3, 6, 5), (1, 2, 5, 4, 6), (1, 1, 3, 4, 3, 4)]


@pytest.mark.parametrize(
    "options", [{}, {"stride": 2, "pad": 1}, {"pad": 1, "dilation": 2}], ids=str
)
@pytest.mark.parametrize("shape", SHAPES, ids=lambda shape: f"{len(shape) - 2}-D")
def test_any_number_of_spatial_axes(run, rng, shape, options):
    x = rng.normal(size=shape)
    done = run(text(kernel_size=2, **options), x)
    assert done.layer.blobs[0].shape == (2, shape[1], *[2] * (len(shape) - 2))
    assert np.allclose(done.y, convolve(x, *(blob.data for blob in done.layer.blobs), **options))


def test_without_items(run, rng):
    """With ``axis: 0`` the bottom is a single image."""
    x = rng.normal(size=(2, 5, 4))
    done = run(text(kernel_size=2, axis=0), x)
    assert np.allclose(done.y, convolve(x[None], *(blob.data for blob in done.layer.blobs))[0])


WINDOWS = [
    {"kernel_size": 3},
    {"kernel_size": 1},
    {"kernel_size": 4, "stride": 2, "pad": 1},
    {"kernel_size": 2, "dilation": 2},
    {"num_output": 4, "kernel_size": 2, "group": 2},
    {"kernel_size": "[2, 3]", "stride": "[1, 2]", "pad": "[0, 1]"},
]


@pytest.mark.parametrize("options", WINDOWS, ids=str)
def test_deconvolution_is_a_convolution_backwards(run, rng, options):
    x = rng.normal(size=(2, 2, 3, 4))
    done = run(text("Deconvolution", **options, bias_term="false"), x)
    back = run(text(**{**options, "num_output": 2}), done.y, params=[done.layer.blobs[0].data])
    assert np.allclose(back.backward(x)[0], done.y)


def test_several_outputs_per_channel_and_several_bottoms(run, rng):
    """DepthwiseConvolution may have a multiple of the channels as outputs: first all those of the
    first channel.
    """
    bottoms = rng.normal(size=(2, 1, 2, 4, 4))
    done = run(
        text("DepthwiseConvolution", num_output=4, group=2, kernel_size=1, bias_term="false"),
        *bottoms,
        tops=2,
    )
    for x, y in zip(bottoms, done.ys):
        twice = x[:, [0, 0, 1, 1]]
        assert np.allclose(y, twice * done.layer.blobs[0].data[:, 0])


def test_convolution_depthwise_ignores_outputs_and_group_with_a_warning(run, caplog):
    """Like the forks, ConvolutionDepthwise has as many outputs as channels whatever
    its options say.
    """
    caplog.set_level(logging.WARNING, "netlib")
    x = np.zeros((1, 4, 3, 3))
    done = run(text("ConvolutionDepthwise", num_output=8, group=2, kernel_size=1), x)
    assert done.y.shape == (1, 4, 3, 3)
    assert done.layer.blobs[0].shape == (4, 1, 1, 1)
    of_outputs, of_group = caplog.messages
    assert "num_output 8" in of_outputs
    assert "group 2" in of_group
    caplog.clear()
    run(text("ConvolutionDepthwise", num_output=4, group=4, kernel_size=1), x)
    assert not caplog.messages


@pytest.mark.parametrize("shape", [(2, 3, 7), (2, 3, 5, 6), (1, 2, 4, 3, 5)], ids=str)
def test_im2col_times_the_kernel_is_a_convolution(run, rng, shape):
    """The product with the kernel equals a Convolution for any number of axes; options of the
    weights are ignored.
    """
    windows = "num_output: 4 bias_term: false kernel_size: 2 stride: 2 pad: 1 dilation: 2"
    x = rng.normal(size=shape)
    w = rng.normal(size=(4, shape[1], *[2] * (len(shape) - 2)))
    columns = run(f'type: "Im2col" convolution_param {{ {windows} }}', x).y
    y = run(f'type: "Convolution" convolution_param {{ {windows} }}', x, params=[w]).y
    assert np.allclose(np.einsum("ok,nk...->no...", w.reshape(4, -1), columns), y)
