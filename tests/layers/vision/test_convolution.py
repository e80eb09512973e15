"""Convolution: shapes, values compared with loops, and errors."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from netlib import gradcheck
from netlib.blob import Blob, Blobs
from tests.support.nets import inputs
from tests.support.plain_loops import check_transpose, convolve


def text(**options):
    options = {"num_output": 2, **options}
    fields = " ".join(f"{name}: {value}" for name, value in options.items())
    fillers = 'weight_filler { type: "gaussian" } bias_filler { type: "gaussian" }'
    return f'type: "Convolution" convolution_param {{ {fields} {fillers} }}'


def test_by_hand(run):
    """A 2 x 2 kernel is applied to a 3 x 3 image without flipping."""
    x = np.arange(9.0).reshape(1, 1, 3, 3)
    done = run(text(num_output=1, kernel_size=2), x, params=[[[[[1, 2], [0, -1]]]], [10]])
    # y = 10 + x[h, w] + 2 x[h, w + 1] - x[h + 1, w + 1]
    assert done.y[0, 0].tolist() == [[10 + 0 + 2 - 4, 10 + 1 + 4 - 5], [10 + 3 + 8 - 7, 10 + 4 + 10 - 8]]
    [dx] = done.backward([[[[1, 0], [0, 0]]]])
    assert dx[0, 0].tolist() == [[1, 2, 0], [0, -1, 0], [0, 0, 0]]
    assert done.layer.blobs[0].diff[0, 0].tolist() == [[0, 1], [3, 4]]
    assert done.layer.blobs[1].diff.tolist() == [1]


PAIRS = st.tuples(st.integers(1, 3), st.integers(1, 3))


@given(
    N=st.integers(1, 3), per=st.integers(1, 2), group=st.integers(1, 2), size=st.tuples(*[st.integers(1, 9)] * 2),
    kernel=PAIRS, stride=PAIRS, pad=st.tuples(*[st.integers(0, 2)] * 2), dilation=PAIRS,
)
def test_any_options_give_what_plain_loops_give(N, per, group, size, kernel, stride, pad, dilation):
    C = O = per * group
    if any(s + 2 * p < d * (k - 1) + 1 for s, p, d, k in zip(size, pad, dilation, kernel)):
        return
    rng = np.random.default_rng(0)
    x, w, b = rng.normal(size=(N, C, *size)), rng.normal(size=(O, per, *kernel)), rng.normal(size=O)
    options = {"num_output": O, "group": group, "dilation": f"[{dilation[0]}, {dilation[1]}]"}
    for name, pair in (("kernel", kernel), ("stride", stride), ("pad", pad)):
        options[f"{name}_h"], options[f"{name}_w"] = pair
    y, dx, dw, db, dy = forward_backward(text(**options), x, w, b)
    assert np.allclose(y, convolve(x, w, b, stride, pad, dilation, group))
    check_transpose(dy, x, w, b, dx, dw, db, lambda x, w, b: convolve(x, w, b, stride, pad, dilation, group))


def forward_backward(text, x, w, b):
    """Return y, dx, dw and db, and the random dy used for them."""
    layer = gradcheck.make_layer(text, [x])
    bottom, top = Blobs([Blob(x.shape, np.float64)]), Blobs([Blob((), np.float64)])
    bottom[0].data[...], layer.blobs[0].data[...] = x, w
    layer.blobs[1].data[...] = b
    layer.reshape(bottom, top)
    layer.forward(bottom, top)
    dy = np.random.default_rng(1).normal(size=top[0].shape)
    top[0].diff[...], bottom[0].diff[...] = dy, np.nan
    layer.backward(top, [True], bottom)
    return top[0].data, bottom[0].diff, layer.blobs[0].diff, layer.blobs[1].diff, dy


def test_several_bottoms_share_the_kernel(run, rng):
    """Each bottom has one top; the gradients of the shared kernel are added."""
    a, b = rng.normal(size=(2, 2, 1, 4, 4))
    both = run(text(num_output=1, kernel_size=2), a, b, tops=2)
    one = run(text(num_output=1, kernel_size=2), a, params=[p.data for p in both.layer.blobs])
    assert np.array_equal(both.ys[0], one.y)
    both.backward(np.ones((2, 1, 3, 3)), np.zeros((2, 1, 3, 3)))
    one.backward(np.ones((2, 1, 3, 3)))
    assert np.allclose(both.layer.blobs[0].diff, one.layer.blobs[0].diff)


def test_the_output_size_is_rounded_down(run):
    """The output size is rounded down: (10 - 3) / 2 + 1 = 4."""
    assert run(text(kernel_size=3, stride=2), np.zeros((1, 1, 10, 12))).y.shape == (1, 2, 4, 5)


def test_axes_before_the_channels_are_items(run, rng):
    x = rng.normal(size=(2, 3, 1, 4, 4))
    five = run(text(kernel_size=2, axis=2), x)
    four = run(text(kernel_size=2), x.reshape(6, 1, 4, 4), params=[p.data for p in five.layer.blobs])
    assert np.allclose(five.y.reshape(four.y.shape), four.y)


def direct(x, w, stride=1, pad=0, dilation=1):
    """Compute the definition for any number of axes: one sum of products per output."""
    axes = x.ndim - 2
    x = np.pad(x, [(0, 0), (0, 0), *[(pad, pad)] * axes])
    reach = [dilation * (k - 1) + 1 for k in w.shape[2:]]
    y = np.zeros((len(x), len(w), *((n - r) // stride + 1 for n, r in zip(x.shape[2:], reach))))
    for n, o, *place in np.ndindex(y.shape):
        window = tuple(slice(p * stride, p * stride + r, dilation) for p, r in zip(place, reach))
        y[(n, o, *place)] = (x[(n, slice(None), *window)] * w[o]).sum()
    return y


SHAPES = [(2, 3), (2, 3, 7), (2, 3, 6, 5), (1, 2, 5, 4, 6), (1, 1, 3, 4, 3, 4)]


@pytest.mark.parametrize("options", [{}, {"stride": 2, "pad": 1}, {"pad": 1, "dilation": 2}], ids=str)
@pytest.mark.parametrize("shape", SHAPES, ids=lambda shape: f"{len(shape) - 2}-D")
def test_any_number_of_spatial_axes(run, rng, shape, options):
    done = run(text(kernel_size=2, bias_term="false", **options), rng.normal(size=shape))
    assert done.layer.blobs[0].shape == (2, shape[1], *[2] * (len(shape) - 2))
    assert np.allclose(done.y, direct(done.bottom[0].data, done.layer.blobs[0].data, **options))


def test_each_axis_has_its_own_numbers(run, rng):
    """kernel_size, stride and pad apply per axis; a volume of one slice equals an image."""
    x = rng.normal(size=(2, 2, 5, 6))
    flat = run(text(kernel_size="[2, 3]", stride="[1, 2]", pad="[1, 0]"), x)
    params = [flat.layer.blobs[0].data[:, :, None], flat.layer.blobs[1].data]
    deep = run(text(kernel_size="[1, 2, 3]", stride="[1, 1, 2]", pad="[0, 1, 0]"), x[:, :, None], params=params)
    assert np.allclose(deep.y[:, :, 0], flat.y)


def test_without_spatial_axes_it_is_an_inner_product(run, rng):
    done = run(text(), rng.normal(size=(3, 4)))
    assert np.allclose(done.y, done.bottom[0].data @ done.layer.blobs[0].data.T + done.layer.blobs[1].data)


def test_without_items(net_of, rng):
    """With ``axis: 0`` the bottom is a single image."""
    net = net_of(inputs(x=(2, 5, 4)) + f'layer {{ name: "c" bottom: "x" top: "y" {text(kernel_size=2, axis=0)} }}')
    x = rng.normal(size=(2, 5, 4))
    y = net.forward(x=x)["y"]
    assert np.allclose(
        y, direct(x[None], net.params["c"][0].data)[0] + net.params["c"][1].data[:, None, None], atol=1e-5
    )
