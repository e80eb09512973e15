"""A convolution, computed together with the layers in place behind it, gives the plain values."""

from __future__ import annotations

import numpy as np
import pytest

import netlib
from fast import depthwise
from fast.fast_layer import FastLayer
from netlib.proto import prototxt
from tests.support.nets import inputs

FILLERS = 'weight_filler { type: "gaussian" std: 0.3 } bias_filler { type: "gaussian" std: 1 }'
NORM = 'type: "BatchNorm" batch_norm_param { use_global_stats: true }'
NORM_OF_BATCH = 'type: "BatchNorm" batch_norm_param { use_global_stats: false }'
SCALE = 'type: "Scale" scale_param { bias_term: true }'
GAIN = 'type: "Scale"'
RELU = 'type: "ReLU"'
RELU6 = 'type: "ReLU6"'
FIRST = {
    "columns": 'type: "Convolution" convolution_param { num_output: 6 kernel_size: 2 stride: 2 %s }',
    "1 x 1": 'type: "Convolution" convolution_param { num_output: 6 kernel_size: 1 %s }',
    "rows": 'type: "Convolution" convolution_param { num_output: 16 kernel_size: 5 pad: 2 %s }',
    "winograd": 'type: "Convolution" convolution_param { num_output: 96 kernel_size: 3 pad: 1 %s }',
    "groups": 'type: "Convolution" convolution_param { num_output: 8 kernel_size: 3 group: 2 bias_term: false %s }',
    "depthwise": 'type: "Convolution" convolution_param { num_output: 96 kernel_size: 3 group: 96 stride: 2 %s }',
    "depthwise of a fork": 'type: "ConvolutionDepthwise" convolution_param { kernel_size: 3 stride: 2 %s }',
    "filtered": 'type: "Convolution" convolution_param { num_output: 96 kernel_size: 3 group: 96 %s }',
    "transposed": 'type: "Deconvolution" convolution_param { num_output: 6 kernel_size: 3 stride: 2 %s }',
    "norm": NORM,
}
CHAINS = {  # layers, and how many of them are fused
    "norm, scale, relu": ([NORM, SCALE, RELU], 3),
    "norm, gain": ([NORM, GAIN], 2),
    "scale, norm": ([SCALE, NORM], 2),
    "gain, relu, scale": ([GAIN, RELU, SCALE], 2),
    "relu": ([RELU], 1),
    "relu6": ([RELU6], 1),
    "scale, relu6": ([SCALE, RELU6], 2),
    "leaky relu6": (['type: "ReLU6" relu6_param { negative_slope: 0.1 }'], 0),
    "leaky relu": (['type: "ReLU" relu_param { negative_slope: 0.1 }'], 0),
    "norm of the batch": ([NORM_OF_BATCH, RELU], 1),
    "norm of the batch, scale, relu": ([NORM_OF_BATCH, SCALE, RELU], 2),
    "norm of the batch, scale, scale": ([NORM_OF_BATCH, SCALE, SCALE], 1),
    "gain of every place": (['type: "Scale" scale_param { num_axes: 2 }'], 0),
}


def make(
    first: str,
    chain: str,
    shape: tuple[int, ...],
    engine: str,
    end: str = "",
    phase: int = 1,
    in_place: bool = True,
) -> netlib.Net:
    """A net with one convolution and layers behind it; its parameters are random."""
    text = FIRST[first].replace("%s", FILLERS)
    kinds, _ = CHAINS[chain]
    tops = ["y" if in_place or i == len(kinds) else f"y{i}" for i in range(len(kinds) + 1)]
    lines = [inputs(x=shape), f'layer {{ name: "first" bottom: "x" top: "{tops[0]}" {text} }}']
    lines += [
        f'layer {{ name: "l{i}" bottom: "{tops[i]}" top: "{tops[i + 1]}" {kind} }}'
        for i, kind in enumerate(kinds)
    ]
    net = netlib.Net(
        prototxt.parse("\n".join(lines) + end), phase, dtype=np.float32, engine=engine, seed=3
    )
    rng = np.random.default_rng(5)
    for layer in net.layers:
        for param in layer.blobs:
            if layer.type == "BatchNorm":
                param.data[...] = rng.uniform(0.5, 1.5, param.shape)
            else:
                param.data[...] = rng.normal(size=param.shape)
    return net


def fused(net: netlib.Net) -> int:
    """The number of layers that are computed by earlier ones."""
    return sum(isinstance(layer, FastLayer) and layer.is_fused for layer in net.layers)


@pytest.mark.parametrize("chain", CHAINS)
@pytest.mark.parametrize("first", FIRST)
@pytest.mark.parametrize("shape", [(1, 96, 14, 17), (3, 96, 9, 8)], ids=str)
def test_the_plain_layers_values(
    first: str, chain: str, shape: tuple[int, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    """One image and a batch in slices; the weights may change between passes, and parts of the
    net may be run.
    """
    monkeypatch.setattr(depthwise, "FILTERED", 100)
    plain, fast = (make(first, chain, shape, engine) for engine in ("plain", "fast"))
    assert fused(fast) == CHAINS[chain][1]
    rng = np.random.default_rng(7)
    *_, before_last, _ = ["first", *(layer.name for layer in plain.layers[2:])]
    for turn in range(2):
        x = rng.normal(size=shape).astype(np.float32)
        for net in (plain, fast):
            net.forward(x=x)
            for params in net.params.values():
                params[0].data[...] *= 1 + turn
        y = plain.blobs["y"].data.copy()
        if "relu6" in chain:  # the rounding is that of larger values
            plain.forward(end=before_last)
        size = np.abs(plain.blobs["y"].data).max()
        np.testing.assert_allclose(fast.blobs["y"].data, y, rtol=0, atol=1e-5 * size)
    for net in (plain, fast):
        net.forward(end="first")
    y = plain.blobs["y"].data
    np.testing.assert_allclose(fast.blobs["y"].data, y, rtol=0, atol=1e-5 * np.abs(y).max())
    assert fused(fast) == 0


@pytest.mark.parametrize("chain", CHAINS)
@pytest.mark.parametrize("first", FIRST)
@pytest.mark.parametrize("items", [1, 4])
def test_layers_that_write_blobs_of_their_own(items: int, first: str, chain: str) -> None:
    shape = (items, 96, 8, 9)
    plain, fast = (
        make(first, chain, shape, engine, in_place=False) for engine in ("plain", "fast")
    )
    assert fused(fast) == CHAINS[chain][1]
    x = np.random.default_rng(7).normal(size=shape).astype(np.float32)
    y, found = (net.forward(x=x)["y"] for net in (plain, fast))
    size = max(np.abs(blob.data).max() for name, blob in plain.blobs.items() if name != "x")
    np.testing.assert_allclose(found, y, rtol=0, atol=1e-5 * size)


@pytest.mark.parametrize(
    ("chain", "count"),
    [
        ("relu", 1),
        ("norm, scale, relu", 0),
        ("norm of the batch, scale, relu", 2),
        ("norm of the batch", 1),
    ],
)
def test_a_backward_pass(chain: str, count: int, rng: np.random.Generator) -> None:
    """Only a ReLU, and a Scale behind a BatchNorm by the statistics of the batch, are fused if
    gradients are computed, which are those of the plain engine, as are the diffs of all blobs, also
    if parts of the net are run.
    """
    end = (
        'layer { name: "l" type: "Reduction" bottom: "y" top: "l" loss_weight: 1 reduction_param '
        "{ operation: SUMSQ } }"
    )
    plain, fast = (
        make("rows", chain, (3, 4, 9, 9), engine, end, netlib.TRAIN) for engine in ("plain", "fast")
    )
    assert fused(fast) == count
    x = rng.normal(size=(3, 4, 9, 9)).astype(np.float32)
    for turn in range(3):
        for net in (plain, fast):
            net.clear_param_diffs()
            net.forward(x=(1 + turn) * x)
            net.backward(start=None if turn < 2 else "l")
        for name, blob in plain.blobs.items():
            size = np.abs(blob.diff).max()
            np.testing.assert_allclose(
                fast.blobs[name].diff, blob.diff, rtol=0, atol=1e-4 * size, err_msg=name
            )
        largest = max(np.abs(param.blob.diff).max() for param in plain.learnable)
        for name, params in plain.params.items():
            for expected, found in zip(params, fast.params[name]):
                # The gradient of a bias before a normalization of the batch is zero.
                size = np.abs(expected.diff).max() if "batch" not in chain else largest
                tolerance = 1e-4 * max(size, 1e-3)
                np.testing.assert_allclose(found.diff, expected.diff, rtol=0, atol=tolerance)
                np.testing.assert_allclose(found.data, expected.data, rtol=1e-5, atol=1e-5)


def test_frozen_layers_in_the_slices_of_trained_ones(rng: np.random.Generator) -> None:
    """A frozen convolution writes the blob of the layer that it computes, as without training."""
    text = (
        inputs(x=(4, 3, 8, 8))
        + 'layer { name: "a" bottom: "x" top: "a" param { lr_mult: 0 } param { lr_mult: 0 } '
        + f"{FIRST['columns'].replace('%s', FILLERS)} }}"
        + f'layer {{ name: "b" bottom: "a" top: "b" {NORM} }}'
        + f'layer {{ name: "c" bottom: "b" top: "c" {FIRST["1 x 1"].replace("%s", FILLERS)} }}'
        + 'layer { name: "l" type: "Reduction" bottom: "c" top: "l" loss_weight: 1 }'
    )
    plain, fast = (
        netlib.Net(prototxt.parse(text), netlib.TRAIN, engine=engine, seed=3)
        for engine in ("plain", "fast")
    )
    assert fused(fast) == 1
    x = rng.normal(size=(4, 3, 8, 8))
    for net in (plain, fast):
        net.forward(x=x)
        net.backward()
    for y, found in (
        (plain.blobs["l"].data, fast.blobs["l"].data),
        (plain.params["c"][0].diff, fast.params["c"][0].diff),
    ):
        np.testing.assert_allclose(found, y, rtol=0, atol=1e-5 * np.abs(y).max())


def test_a_scale_behind_a_batch_norm_without_a_gradient(rng: np.random.Generator) -> None:
    """It writes the gradient that the prototxt asks for, which the BatchNorm does not continue."""
    text = (
        inputs(x=(4, 3, 5, 5))
        + f'layer {{ name: "b" bottom: "x" top: "b" {NORM_OF_BATCH} }}'
        + 'layer { name: "s" bottom: "b" top: "b" type: "Scale" propagate_down: true }'
        + 'layer { name: "l" type: "Reduction" bottom: "b" top: "l" loss_weight: 1 }'
    )
    for engine in ("plain", "fast"):
        net = netlib.Net(prototxt.parse(text), netlib.TRAIN, engine=engine)
        net.params["s"][0].data[...] = 3
        net.forward(x=rng.normal(size=(4, 3, 5, 5)))
        net.backward()
        assert (net.blobs["b"].diff == 3).all()


def test_a_batch_norm_alone_keeps_what_the_scale_behind_it_reads(rng: np.random.Generator) -> None:
    """Backward after a part with new values: the Scale has not run, so its gradient is that of the
    values before.
    """
    text = (
        inputs(x=(4, 3, 5, 5))
        + f'layer {{ name: "b" bottom: "x" top: "b" {NORM_OF_BATCH} }}'
        + 'layer { name: "s" bottom: "b" top: "b" type: "Scale" }'
        + 'layer { name: "l" type: "Reduction" bottom: "b" top: "l" loss_weight: 1 }'
    )
    first, new = rng.normal(size=(2, 4, 3, 5, 5))
    gradients = []
    for engine in ("plain", "fast"):
        net = netlib.Net(prototxt.parse(text), netlib.TRAIN, engine=engine)
        net.forward(x=first)
        net.forward(x=new, end="b")
        net.blobs["b"].diff[...] = first
        net.backward(start="s")
        gradients.append(net.params["s"][0].diff)
    np.testing.assert_allclose(*gradients, rtol=1e-4)
