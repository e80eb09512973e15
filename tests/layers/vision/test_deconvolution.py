"""Deconvolution, the transpose of Convolution."""

import numpy as np
import pytest


def text(kind="Deconvolution", **options):
    fields = " ".join(f"{name}: {value}" for name, value in {"num_output": 2, **options}.items())
    fillers = 'weight_filler { type: "gaussian" } bias_filler { type: "gaussian" }'
    return f'type: "{kind}" convolution_param {{ {fields} {fillers} }}'


def test_by_hand(run):
    """Two values each add the kernel 1, 2, 3; with stride 2 the kernels overlap in one pixel. The bias is 10."""
    done = run(text(num_output=1, kernel_h=1, kernel_w=3, stride=2), [[[[1, 5]]]], params=[[[[[1, 2, 3]]]], [10]])
    assert done.y.ravel().tolist() == [11, 12, 13 + 5, 20, 25]
    [dx] = done.backward([[[[1, 0, 0, 0, 1]]]])
    assert dx.ravel().tolist() == [1, 3]
    assert done.layer.blobs[0].diff.ravel().tolist() == [1, 0, 5]
    assert done.layer.blobs[1].diff.tolist() == [2]


OPTIONS = [
    {"kernel_size": 3}, {"kernel_size": 1}, {"kernel_size": 4, "stride": 2, "pad": 1},
    {"kernel_size": 2, "dilation": 2}, {"num_output": 4, "kernel_size": 2, "group": 2},
    {"kernel_size": "[2, 3]", "stride": "[1, 2]", "pad": "[0, 1]"}, {"kernel_size": 2, "bias_term": "false"},
]


@pytest.mark.parametrize("options", OPTIONS[:-1], ids=str)
def test_it_is_a_convolution_backwards(run, rng, options):
    x = rng.normal(size=(2, 2, 3, 4))
    done = run(text(**{**options, "bias_term": "false"}), x)
    back = run(text("Convolution", **{**options, "num_output": 2}), done.y, params=[done.layer.blobs[0].data])
    assert np.allclose(back.backward(x)[0], done.y)


def test_upsampling(run):
    """One bilinear kernel per channel upsamples a ramp exactly, away from the edge."""
    options = (
        'num_output: 2 group: 2 kernel_size: 4 stride: 2 pad: 1 bias_term: false weight_filler { type: "bilinear" }'
    )
    ramp = np.broadcast_to(np.arange(4.0), (1, 2, 4, 4))
    done = run(f'type: "Deconvolution" convolution_param {{ {options} }}', ramp)
    assert done.y.shape == (1, 2, 8, 8)
    assert np.allclose(done.y[:, :, 1:-1, 1:-1], np.arange(0.25, 3, 0.5))
