"""BN of SegNet and PSPNet."""

import numpy as np
import pytest

from netlib import gradcheck

PSPNET = 'slope_filler { type: "gaussian" } bias_filler { type: "gaussian" }'


def text(options):
    return f'type: "BN" bn_param {{ {options} }}'


def normalized(x, eps):
    m, v = x.mean(axis=(0, 2, 3), keepdims=True), x.var(axis=(0, 2, 3), keepdims=True)
    return (x - m) / np.sqrt(v + eps), m, v


@pytest.mark.parametrize("phase", ["TRAIN", "TEST"])
def test_segnet_learns_with_the_statistics_of_the_batch(run, rng, phase):
    """With LEARN, both phases normalize by the batch, and two more tops have its
    mean and variance.
    """
    x = rng.normal(3, 2, size=(2, 3, 4, 5))
    scale, bias = rng.normal(size=(2, 1, 3, 1, 1))
    done = run(text("bn_mode: LEARN"), x, tops=3, phase=phase, params=[scale, bias])
    z, m, v = normalized(x, 1e-9)
    assert np.allclose(done.ys[0], scale * z + bias)
    assert np.allclose(done.ys[1], m)
    assert np.allclose(done.ys[2], v)
    assert [blob.shape for blob in done.layer.blobs] == [(1, 3, 1, 1)] * 2


def test_segnet_infers_with_scale_and_bias_only(run, rng):
    """With INFERENCE, the statistics are part of scale and bias."""
    x = rng.normal(3, 2, size=(2, 2, 1, 2))
    params = np.reshape([[2.0, 3], [-1, 1]], (2, 1, 2, 1, 1))
    done = run(text("bn_mode: INFERENCE"), x, params=params)
    assert np.allclose(done.y[:, 0], 2 * x[:, 0] - 1)
    assert np.allclose(done.y[:, 1], 3 * x[:, 1] + 1)
    assert np.allclose(done.backward(np.ones_like(x))[0][:, 1], 3)


def test_pspnet_learns_and_averages(run, rng):
    """In TRAIN, the moving averages follow the mean and the variance of the batch,
    without a correction.
    """
    x = rng.normal(3, 2, size=(2, 3, 4, 5))
    done = run(
        text("momentum: 0.75"),
        x,
        params=[[[[[1]]] * 3], np.zeros((1, 3, 1, 1)), [[[[8]]] * 3], [[[[4]]] * 3]],
    )
    z, m, v = normalized(x, 1e-5)
    assert np.allclose(done.y, z)
    assert np.allclose(done.layer.blobs[2].data, 0.75 * 8 + 0.25 * m)
    assert np.allclose(done.layer.blobs[3].data, 0.75 * 4 + 0.25 * v)
    assert [param.lr_mult for param in done.layer.spec.param] == [1, 1, 0, 0]


@pytest.mark.parametrize(
    ("options", "phase"), [("momentum: 0.9", "TEST"), ("frozen: true", "TRAIN")]
)
def test_pspnet_tests_with_its_averages(run, rng, options, phase):
    """In TEST, or if frozen, it normalizes by the averages, which do not change."""
    x = rng.normal(size=(2, 3, 4, 5))
    scale, bias, mean = rng.normal(size=(3, 1, 3, 1, 1))
    variance = rng.uniform(0.5, 2, size=(1, 3, 1, 1))
    done = run(text(f"{options} eps: 0.01"), x, phase=phase, params=[scale, bias, mean, variance])
    assert np.allclose(done.y, scale * (x - mean) / np.sqrt(variance + 0.01) + bias)
    assert np.array_equal(done.layer.blobs[2].data, mean)
    assert [param.lr_mult for param in done.layer.spec.param] == [
        0 if "frozen" in options else 1
    ] * 2 + [0, 0]


@pytest.mark.parametrize("in_place", [False, True])
def test_frozen_averages_have_no_gradient(rng, in_place):
    """Those of x, scale and bias agree with differences, as with the other options."""
    x = rng.normal(size=(3, 2, 2, 3))
    layer = gradcheck.make_layer(text(f"frozen: true {PSPNET}"), [x])
    found = list(gradcheck.gradients(layer, [x], in_place=in_place))
    learned = [gradient for gradient in found if gradient.number < 2]
    assert [gradient.kind for gradient in learned] == ["bottom", "parameter", "parameter"]
    for gradient in learned:
        assert np.allclose(gradient.analytic, gradient.differences(), rtol=0, atol=1e-6)
