"""backward without a forward pass: with the current data, and zeros for what forward would have stored, as in Caffe."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import netlib
from netlib.proto import prototxt, schema
from netlib.proto.messages import SolverParameter

pytestmark = pytest.mark.both_engines

X = 'layer { name: "x" type: "Input" top: "x" input_param { shape { dim: 2 dim: 3 } } }'
MAPS = 'layer { name: "x" type: "Input" top: "x" input_param { shape { dim: 2 dim: 1 dim: 4 dim: 4 } } }'
LABELS = 'layer { name: "t" type: "Input" top: "t" input_param { shape { dim: 2 } } }'
LINEAR = (
    'layer { name: "%s" type: "InnerProduct" bottom: "%s" top: "%s" '
    'inner_product_param { num_output: 2 weight_filler { type: "constant" value: %g } } }'
)
CHAIN = X + LINEAR % ("a", "x", "y", 3) + LINEAR % ("b", "y", "z", 5)  # dx = 2 * 2 * 3 * 5 = 60 for dz = 1


def net_of(text: str, phase: int = netlib.TRAIN) -> netlib.Net:
    """Build a net with all gradients."""
    return netlib.Net(prototxt.parse("force_backward: true " + text), phase, seed=1)


def layer(kind: str, options: str = "", bottom: str = 'bottom: "x"', top: str = "y") -> str:
    """Return a layer of the type ``kind``."""
    return f'layer {{ name: "k" type: "{kind}" {bottom} top: "{top}" {options} }}'


def reshaped(net: netlib.Net, items: int, propagate: bool = True) -> None:
    """Run the net, then change the number of items."""
    net.forward()
    net.blobs["x"].reshape(items, 3)
    if propagate:
        net.reshape()


BEFORE: dict[str, Callable[[netlib.Net], object]] = {
    "nothing": lambda net: None,
    "the last layer": lambda net: net.forward(start="b"),
    "the first layers": lambda net: net.forward(end="a"),
    "a larger batch": lambda net: reshaped(net, 5),
    "a smaller batch": lambda net: reshaped(net, 1),
    "no reshape of the net": lambda net: reshaped(net, 2, propagate=False),
    "backward": lambda net: net.backward(),
}


@pytest.mark.parametrize("before", list(BEFORE))
def test_the_gradient_of_a_linear_net_needs_no_forward(before: str) -> None:
    """In a linear net, backward gives the same gradient whatever has run before."""
    net = net_of(CHAIN)
    BEFORE[before](net)
    dx = net.backward(z=np.ones(net.blobs["z"].shape))["x"]
    assert dx.shape == net.blobs["x"].shape
    np.testing.assert_allclose(dx, 60)


def test_a_blob_reshaped_by_the_caller_is_propagated_first() -> None:
    """If only the input blob was reshaped, backward reshapes the net."""
    net = net_of(CHAIN)
    net.forward()
    net.blobs["x"].reshape(7, 3)
    assert net.backward()["x"].shape == (7, 3)
    assert net.blobs["z"].diff.shape == (7, 2)


def test_the_parameters_have_the_gradient_of_the_current_data() -> None:
    """dw = dyᵀ x of the data that the caller has written into the blobs."""
    net = net_of(CHAIN)
    net.blobs["x"].data[...] = 2
    net.blobs["y"].data[...] = 7
    net.backward(z=np.ones((2, 2)))
    np.testing.assert_allclose(net.params["b"][0].diff, 14)
    np.testing.assert_allclose(net.params["a"][0].diff, 2 * 2 * 10)


def test_a_middle_blob_is_set_and_the_rest_runs() -> None:
    """After forward(start=...), the layers before it use the data that their blobs have."""
    net = net_of(
        X + LINEAR % ("a", "x", "y", 1) + layer("ReLU", bottom='bottom: "y"', top="r") + LINEAR % ("b", "r", "z", 1)
    )
    net.blobs["y"].data[...] = [[1, -1], [0, 2]]
    net.forward(start="k")
    np.testing.assert_allclose(net.blobs["z"].data, [[1, 1], [2, 2]])
    dx = net.backward(z=np.ones((2, 2)))["x"]
    np.testing.assert_allclose(dx, [[2] * 3] * 2)


def test_a_pass_layer_by_layer_is_complete() -> None:
    """Layers that run one by one with new shapes have all run, so that nothing is cleared."""
    text = (
        X + LINEAR % ("a", "x", "y", 1) + layer("Dropout", bottom='bottom: "y"', top="r") + LINEAR % ("b", "r", "z", 1)
    )
    net = net_of(text)
    net.forward()
    net.blobs["x"].reshape(6, 3)
    net.blobs["x"].data[...] = 1
    for name in net.layer_dict:
        net.forward(start=name, end=name)
    assert net.backward(z=np.ones((6, 2)))["x"].shape == (6, 3)
    np.testing.assert_array_equal(net.blobs["y"].diff != 0, net.blobs["r"].data != 0)
    assert net.blobs["y"].diff.any()


def test_a_part_with_new_shapes_keeps_what_it_stored() -> None:
    """After a part of a pass with a new batch size, a full backward reshapes the rest and keeps the part's masks."""
    text = X + layer("Dropout", top="r") + LINEAR % ("b", "r", "z", 1)
    net = net_of(text)
    net.forward()
    net.blobs["x"].reshape(6, 3)
    net.blobs["x"].data[...] = 1
    net.forward(end="k")
    mask = net.blobs["r"].data.copy()
    net.reshape()
    np.testing.assert_allclose(net.backward(z=np.ones((6, 2)))["x"], 2 * mask)


# Layer that stores something in forward -> its gradient before the first forward for dy = 1; x = 1 in every place.
STORED = {
    "BNLL": (X + layer("BNLL"), 1 / (1 + np.exp(-1))),  # Caffe's backward reads x
    "Clip": (X + layer("Clip", "clip_param { min: 0 max: 2 }"), 1),
    "Dropout": (X + layer("Dropout"), 0),
    "ELU": (X + layer("ELU"), 1),
    "Eltwise": (X + layer("Eltwise", "eltwise_param { operation: MAX }", 'bottom: "x" bottom: "x"'), 1),
    "EuclideanLoss": (X + layer("EuclideanLoss", bottom='bottom: "x" bottom: "x"'), 0),
    "Exp": (X + layer("Exp"), 0),  # reads y
    "HingeLoss": (X + LABELS + layer("HingeLoss", bottom='bottom: "x" bottom: "t"'), 0),
    "InfogainLoss": (
        X + LABELS + 'layer { name: "h" type: "Input" top: "h" input_param { shape { dim: 3 dim: 3 } } }'
        + layer("InfogainLoss", bottom='bottom: "x" bottom: "t" bottom: "h"'), 0),
    "Log": (X + layer("Log", "log_param { shift: 1 }"), 0.5),
    "Pooling": (MAPS + layer("Pooling", "pooling_param { kernel_size: 2 stride: 2 }"), [4] + [0] * 15),
    "Power": (X + layer("Power", "power_param { power: 3 }"), 3),
    "PReLU": (X + layer("PReLU"), 1),
    "SoftmaxWithLoss": (X + LABELS + layer("SoftmaxWithLoss", bottom='bottom: "x" bottom: "t"'), [-0.5, 0, 0]),
    "Swish": (X + layer("Swish"), 0),
}


@pytest.mark.parametrize("kind", list(STORED))
def test_what_forward_stores_is_zero_before_it(kind: str) -> None:
    """Masks, winners, differences and probabilities are zeros; values that Caffe computes in backward are not."""
    text, expected = STORED[kind]
    net = net_of(text)
    net.blobs["x"].data[...] = 1
    net.blobs["y"].diff[...] = 1
    dx = net.backward()["x"]
    np.testing.assert_allclose(dx.reshape(2, -1), np.broadcast_to(expected, dx.reshape(2, -1).shape), rtol=1e-5)


def test_a_forward_pass_gives_the_usual_gradient_again() -> None:
    """A backward before the first forward leaves no trace, in the weights' gradients apart."""
    text = MAPS + layer("Pooling", "pooling_param { kernel_size: 2 stride: 2 }") + LINEAR % ("b", "y", "z", 0.5)
    one, two = net_of(text), net_of(text)
    two.backward(z=np.ones((2, 2)))
    two.clear_param_diffs()
    x = np.random.default_rng(0).normal(size=(2, 1, 4, 4))
    for net in (one, two):
        net.forward(x=x)
    np.testing.assert_array_equal(one.backward(z=np.ones((2, 2)))["x"], two.backward(z=np.ones((2, 2)))["x"])
    np.testing.assert_array_equal(one.params["b"][0].diff, two.params["b"][0].diff)


def test_a_python_layer_that_stores_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A layer of type Python runs backwards first; its forward is not called."""
    (tmp_path / "tripled.py").write_text(
        "import caffe\n"
        "class Tripled(caffe.Layer):\n"
        "    def setup(self, bottom, top): pass\n"
        "    def reshape(self, bottom, top): top[0].reshape(*bottom[0].data.shape)\n"
        "    def forward(self, bottom, top): raise RuntimeError\n"
        "    def backward(self, top, propagate_down, bottom): bottom[0].diff[...] = 3 * top[0].diff\n"
    )
    monkeypatch.syspath_prepend(tmp_path)
    net = net_of(X + layer("Python", 'python_param { module: "tripled" layer: "Tripled" }'))
    net.blobs["y"].diff[...] = 7
    net.backward()
    assert (net.blobs["x"].diff == 21).all()


def test_a_solver_trains_as_usual_after_a_backward_pass() -> None:
    """solver.net.backward() before the first step adds a gradient that the step clears; no random number is drawn."""
    data = (
        'layer { name: "d" type: "DummyData" top: "x" top: "t" dummy_data_param { shape { dim: 4 dim: 3 } '
        'shape { dim: 4 dim: 2 } data_filler { type: "gaussian" } data_filler { type: "constant" value: 1 } } }'
    )
    net = data + LINEAR % ("a", "x", "y", 0.1) + layer("Dropout", bottom='bottom: "y"', top="r")
    net += 'layer { name: "l" type: "EuclideanLoss" bottom: "r" bottom: "t" top: "l" }'
    text = f'net_param {{ {net} }} base_lr: 0.1 lr_policy: "fixed" random_seed: 3'
    results = []
    for first in (False, True):
        solver = netlib.Solver(schema.read(prototxt.parse(text), SolverParameter))
        if first:
            solver.net.backward()
        solver.step(3)
        results.append(solver.net.params["a"][0].data.copy())
    np.testing.assert_array_equal(*results)
