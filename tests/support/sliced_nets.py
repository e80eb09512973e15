"""Nets that the fast engine runs in slices, their passes, and what their blobs hold."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

import netlib

MakeNet = Callable[..., netlib.Net]
Arrays = dict[str, np.ndarray]

PAPER = """
    layer { name: "depth" type: "Input" top: "depth" input_param { shape { dim: 2 dim: 1 dim: 128 dim: 128 } } }
    layer { name: "c1" type: "Convolution" bottom: "depth" top: "c1"
            convolution_param { num_output: 8 kernel_size: 5
                                weight_filler { type: "xavier" } bias_filler { type: "uniform" min: -0.1 max: 0.1 } } }
    layer { name: "r1" type: "ReLU" bottom: "c1" top: "c1" }
    layer { name: "p1" type: "Pooling" bottom: "c1" top: "p1" pooling_param { kernel_size: 4 stride: 4 } }
    layer { name: "c2" type: "Convolution" bottom: "p1" top: "c2"
            convolution_param { num_output: 8 kernel_size: 5
                                weight_filler { type: "xavier" } bias_filler { type: "uniform" min: -0.1 max: 0.1 } } }
    layer { name: "r2" type: "ReLU" bottom: "c2" top: "c2" }
    layer { name: "p2" type: "Pooling" bottom: "c2" top: "p2" pooling_param { kernel_size: 2 stride: 2 } }
    layer { name: "c3" type: "Convolution" bottom: "p2" top: "c3"
            convolution_param { num_output: 8 kernel_size: 3
                                weight_filler { type: "xavier" } bias_filler { type: "uniform" min: -0.1 max: 0.1 } } }
    layer { name: "r3" type: "ReLU" bottom: "c3" top: "c3" }
    layer { name: "fc" type: "InnerProduct" bottom: "c3" top: "fc"
            inner_product_param { num_output: 10 weight_filler { type: "xavier" } } }
    layer { name: "label" type: "Input" top: "label" input_param { shape { dim: 2 dim: 10 } } }
    layer { name: "loss" type: "EuclideanLoss" bottom: "fc" bottom: "label" top: "loss" }
"""
UNSTORED = ["c1", "p1", "c2", "p2"]
TWO_SIZES = """
    force_backward: true
    layer { name: "in" type: "Input" top: "x" top: "y" top: "s"
            input_param { shape { dim: 4 dim: 1 dim: 8 dim: 8 } shape { dim: 4 dim: 1 dim: 8 dim: 8 }
                          shape { dim: 4 } } }
    layer { name: "f" type: "Filter" bottom: "x" bottom: "s" top: "fx" }
    %s
"""
CONV = """
    layer { name: "%(top)s" type: "Convolution" bottom: "%(bottom)s" top: "%(top)s"
            convolution_param { num_output: 2 kernel_size: 3 weight_filler { type: "xavier" } } }
    layer { name: "r%(top)s" type: "ReLU" bottom: "%(top)s" top: "%(top)s" }
"""
OF_X = CONV % {"top": "cx", "bottom": "fx"}
OF_Y = CONV % {"top": "cy", "bottom": "y"}


def batch(count: int, seed: int = 0, flat: bool = True) -> Arrays:
    """Images like depth crops with an object before a constant background, and labels.

    One image is only background.

    Unless ``flat``, the background is rough. On a flat background the values of a convolution are
    equal except for rounding, so a max pooling after it may pass the gradient to any of them.
    """
    rng = np.random.default_rng(seed)
    x = np.ones((count, 1, 128, 128), np.float32)
    if not flat:
        x[...] = rng.uniform(0.5, 1, x.shape)
    for i in range(count):
        if i != 1:
            top, left = rng.integers(0, 100, 2)
            hand = x[i, 0, top : top + 60, left : left + 50]
            hand[...] = rng.uniform(-1, 1, hand.shape)
    return {"depth": x, "label": rng.normal(size=(count, 10)).astype(np.float32)}


def unstored(net: netlib.Net) -> list[str]:
    """Names of the blobs that are not stored."""
    blobs = {blob for step in net.steps for blob in step.unstored}
    return [name for name, blob in net.blobs.items() if blob in blobs]


def layer_by_layer(net: netlib.Net) -> netlib.Net:
    """Run a part of a net, so that it runs layer by layer from then on; returns the net."""
    net.forward(end=net.layers[-1].name)
    return net


def feed(net: netlib.Net, inputs: Arrays) -> None:
    """Run a batch of any size forwards."""
    for name, array in inputs.items():
        net.blobs[name].reshape(array.shape)
    net.reshape()
    net.forward(**inputs)


def everything(net: netlib.Net, inputs: Arrays) -> Arrays:
    """Outputs and all gradients of one pass, forward and backward."""
    net.clear_param_diffs()
    feed(net, inputs)
    net.backward()
    found = {name: net.blobs[name].data.copy() for name in net.outputs}
    found.update({f"d{name}": net.blobs[name].diff.copy() for name in net.inputs})
    return {**found, **{p.label: p.blob.diff.copy() for p in net.learnable}}


def difference(got: np.ndarray, want: np.ndarray) -> float:
    """Relative difference max |got - want| / max |want|."""
    assert got.shape == want.shape
    return float(np.abs(got - want).max(initial=0) / max(np.abs(want).max(initial=0), 1e-30))


def assert_close(got: Arrays, want: Arrays, tolerance: float) -> None:
    """Assert that the relative difference of every array is within the tolerance."""
    assert got.keys() == want.keys()
    for name, array in want.items():
        assert difference(got[name], array) <= tolerance, name


def assert_equal(got: Arrays, want: Arrays) -> None:
    assert got.keys() == want.keys()
    for name, array in want.items():
        assert np.array_equal(got[name], array), name


def expected_of(net_of: MakeNet, inputs: Arrays) -> dict[str, Arrays]:
    """Data and diff of every blob of the paper's network, and the parameters' diffs,
    layer by layer.
    """
    net = layer_by_layer(net_of(PAPER))
    grads = everything(net, inputs)
    return {
        "data": {name: blob.data.copy() for name, blob in net.blobs.items()},
        "diff": {name: blob.diff.copy() for name, blob in net.blobs.items()},
        "grads": grads,
    }


def check_blob(net: netlib.Net, name: str, half: str, expected: dict[str, Arrays]) -> None:
    assert difference(getattr(net.blobs[name], half), expected[half][name]) <= 2e-5, (name, half)
