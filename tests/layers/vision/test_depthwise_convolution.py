"""DepthwiseConvolution and ConvolutionDepthwise."""

import logging

import numpy as np
import pytest

FILLERS = 'weight_filler { type: "gaussian" } bias_filler { type: "gaussian" }'


def text(kind, **options):
    return f'type: "{kind}" convolution_param {{ {" ".join(f"{k}: {v}" for k, v in options.items())} {FILLERS} }}'


def test_by_hand(run):
    """Each channel is filtered by its own kernel: sums of two pixels, and differences of them."""
    x = [[[[1.0, 2, 4]], [[5, 5, 9]]]]
    for kind, more in (("DepthwiseConvolution", {"num_output": 2, "group": 2}), ("ConvolutionDepthwise", {})):
        done = run(text(kind, kernel_h=1, kernel_w=2, **more), x, params=[[[[[1, 1]]], [[[-1, 1]]]], [10, 20]])
        assert done.y[0, :, 0].tolist() == [[13, 16], [20, 24]]
        [dx] = done.backward([[[[1, 10]], [[1, 10]]]])
        assert dx[0, :, 0].tolist() == [[1, 11, 10], [-1, -9, 10]]
        assert done.layer.blobs[0].diff[:, 0, 0].tolist() == [[21, 42], [55, 95]]
        assert done.layer.blobs[1].diff.tolist() == [11, 11]


OPTIONS = [
    {"kernel_size": 3, "pad": 1}, {"kernel_size": 3, "stride": 2, "pad": 1}, {"kernel_size": 2, "dilation": 2},
    {"kernel_h": 1, "kernel_w": 3, "stride_h": 1, "stride_w": 2, "pad_h": 0, "pad_w": 1},
    {"kernel_size": "[3, 2]", "bias_term": "false"},
]


@pytest.mark.parametrize("size", [(5, 6), (40, 33)], ids=str)
@pytest.mark.parametrize("options", OPTIONS, ids=str)
def test_it_is_a_convolution_with_a_group_per_channel(run, rng, options, size):
    x = rng.normal(size=(2, 3, *size))
    same = run(text("Convolution", num_output=3, group=3, **options), x)
    dy = rng.normal(size=same.y.shape)
    want = same.backward(dy)[0]
    for kind, more in (("DepthwiseConvolution", {"num_output": 3, "group": 3}), ("ConvolutionDepthwise", {})):
        done = run(text(kind, **more, **options), x, params=[blob.data for blob in same.layer.blobs])
        assert np.allclose(done.y, same.y, rtol=0, atol=1e-12)
        assert np.allclose(done.backward(dy)[0], want, rtol=0, atol=1e-12)
        for ours, theirs in zip(done.layer.blobs, same.layer.blobs):
            assert np.allclose(ours.diff, theirs.diff, rtol=0, atol=1e-10)


def test_several_outputs_per_channel(run, rng):
    """DepthwiseConvolution may have a multiple of the channels as outputs: first all those of the first channel."""
    x = rng.normal(size=(1, 2, 4, 4))
    done = run(text("DepthwiseConvolution", num_output=4, group=2, kernel_size=1, bias_term="false"), x)
    assert np.allclose(done.y, x[:, [0, 0, 1, 1]] * done.layer.blobs[0].data[:, 0])


def test_several_bottoms(run, rng):
    x = rng.normal(size=(2, 3, 4, 4))
    done = run(text("DepthwiseConvolution", num_output=3, group=3, kernel_size=3), x, x[:1], tops=2)
    assert np.allclose(done.ys[1], done.ys[0][:1])


def test_convolution_depthwise_ignores_outputs_and_group_with_a_warning(run, caplog):
    """Like the forks, ConvolutionDepthwise has as many outputs as channels whatever its options say."""
    with caplog.at_level(logging.WARNING, "netlib"):
        done = run(text("ConvolutionDepthwise", num_output=8, group=2, kernel_size=1), np.zeros((1, 4, 3, 3)))
    assert done.y.shape == (1, 4, 3, 3)
    assert done.layer.blobs[0].shape == (4, 1, 1, 1)
    assert [("num_output 8" in r.getMessage(), "group 2" in r.getMessage()) for r in caplog.records] == [
        (True, False),
        (False, True),
    ]
    caplog.clear()
    run(text("ConvolutionDepthwise", num_output=4, group=4, kernel_size=1), np.zeros((1, 4, 3, 3)))
    assert not caplog.records
