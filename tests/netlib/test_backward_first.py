"""backward before forward: layers that have not run are run forwards once, and what has run is
not run again.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

import netlib
from netlib.proto import prototxt
from tests.support.nets import X

pytestmark = pytest.mark.both_engines

LINEAR = (
    'layer { name: "%s" type: "InnerProduct" bottom: "%s" top: "%s" '
    'inner_product_param { num_output: 2 weight_filler { type: "constant" value: %g } } }'
)
# dx = 2 * 2 * 3 * 5 = 60 for dz = 1
CHAIN = X + LINEAR % ("a", "x", "y", 3) + LINEAR % ("b", "y", "z", 5)


def net_of(text: str) -> netlib.Net:
    return netlib.Net(prototxt.parse("force_backward: true " + text), netlib.TRAIN, seed=1)


def layer(kind: str, options: str = "", bottom: str = 'bottom: "x"', top: str = "y") -> str:
    return f'layer {{ name: "k" type: "{kind}" {bottom} top: "{top}" {options} }}'


def reshaped(net: netlib.Net, items: int) -> None:
    net.forward()
    net.blobs["x"].reshape(items, 3)
    net.reshape()


BEFORE: dict[str, Callable[[netlib.Net], object]] = {
    "nothing": lambda net: None,
    "the last layer": lambda net: net.forward(start="b"),
    "the first layers": lambda net: net.forward(end="a"),
    "a larger batch": lambda net: reshaped(net, 5),
    "a smaller batch": lambda net: reshaped(net, 1),
    "a blob reshaped by the caller": lambda net: (net.forward(), net.blobs["x"].reshape(7, 3)),
    "backward": lambda net: net.backward(),
}


@pytest.mark.parametrize("before", list(BEFORE))
def test_the_gradient_of_a_linear_net_is_the_same_whatever_has_run(before: str) -> None:
    net = net_of(CHAIN)
    BEFORE[before](net)
    net.blobs["z"].reshape(net.blobs["x"].shape[0], 2)
    dx = net.backward(z=np.ones(net.blobs["z"].shape))["x"]
    assert dx.shape == net.blobs["x"].shape
    np.testing.assert_allclose(dx, 60)


def test_the_parameters_have_the_gradient_of_the_current_input() -> None:
    net = net_of(CHAIN)
    net.blobs["x"].data[...] = 2
    net.backward(z=np.ones((2, 2)))
    np.testing.assert_allclose(net.blobs["y"].data, 18)
    np.testing.assert_allclose(net.params["b"][0].diff, 2 * 18)
    np.testing.assert_allclose(net.params["a"][0].diff, 2 * 2 * 10)


def test_a_diff_that_the_caller_wrote_stays() -> None:
    net = net_of(CHAIN)
    net.blobs["z"].diff[...] = 1
    np.testing.assert_allclose(net.backward()["x"], 60)


def test_a_middle_blob_that_was_written_and_read_keeps_its_values() -> None:
    """After forward(start=...), backward runs the layers before it once, but not over what the
    others have read.
    """
    net = net_of(
        X
        + LINEAR % ("a", "x", "y", 1)
        + layer("ReLU", bottom='bottom: "y"', top="r")
        + LINEAR % ("b", "r", "z", 1)
    )
    net.blobs["y"].data[...] = [[1, -1], [0, 2]]
    net.forward(start="k")
    np.testing.assert_allclose(net.blobs["z"].data, [[1, 1], [2, 2]])
    np.testing.assert_allclose(net.backward(z=np.ones((2, 2)))["x"], [[2] * 3] * 2)
    np.testing.assert_allclose(net.blobs["y"].data, [[1, -1], [0, 2]])


def test_a_part_that_has_run_is_not_run_again() -> None:
    """After a part with a new batch size, a full backward runs the rest and keeps the
    mask of the part.
    """
    net = net_of(X + layer("Dropout", top="r") + LINEAR % ("b", "r", "z", 1))
    net.forward()
    net.blobs["x"].reshape(6, 3)
    net.blobs["x"].data[...] = 1
    net.forward(end="k")
    net.reshape()
    mask = net.blobs["r"].data.copy()
    np.testing.assert_allclose(net.backward(z=np.ones((6, 2)))["x"], 2 * mask)
    np.testing.assert_allclose(net.blobs["r"].data, mask)


RANDOM = {
    "draws random numbers": X + layer("Dropout"),
    "reads data": 'layer { name: "k" type: "DummyData" top: "x" dummy_data_param { shape { dim: 4 dim: 3 } } }'
    + LINEAR % ("a", "x", "y", 1),
}


@pytest.mark.parametrize("what", list(RANDOM))
def test_a_net_whose_forward_pass_changes_the_next_one_needs_forward_first(what: str) -> None:
    net, other = net_of(RANDOM[what]), net_of(RANDOM[what])
    with pytest.raises(
        netlib.LayerError,
        match=rf"layer 'k': backward was called before forward, which {what}: run",
    ):
        net.backward()
    np.testing.assert_array_equal(net.forward()["y"], other.forward()["y"])
    net.backward()


def test_a_layer_whose_forward_fails_runs_again(monkeypatch: pytest.MonkeyPatch) -> None:
    """The slopes of tanh are those of the new input, not of the last pass that was complete."""
    net = net_of(X + layer("TanH"))
    shape = net.blobs["x"].shape
    net.forward(x=np.full(shape, 3))

    def fail(*args: object) -> None:
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(net.layer_dict["k"], "forward", fail)
        with pytest.raises(KeyboardInterrupt):
            net.forward(x=np.zeros(shape))
    np.testing.assert_allclose(net.backward(y=np.ones(shape))["x"], 1)


def test_a_net_of_another_size_for_a_while() -> None:
    """Its values are discarded, so backward runs the layers again with the current input, 0."""
    net = net_of(X + layer("TanH") + 'layer { type: "Softmax" bottom: "y" top: "z" }')
    net.forward(x=np.full((2, 3), 3))
    for items in (5, 2):
        net.blobs["x"].reshape(items, 3)
        net.reshape()
    dx = net.backward(z=[[9, 0, 0]] * 2)["x"]  # dx = p (dz - sum of p dz) for p = 1/3 everywhere
    np.testing.assert_allclose(dx, [[2, -1, -1]] * 2, rtol=1e-6)


TWO_BRANCHES = """
layer { name: "a" type: "Input" top: "a" input_param { shape { dim: 3 dim: 1 dim: 5 dim: 6 } } }
layer { name: "b" type: "Input" top: "b" input_param { shape { dim: 3 dim: 1 dim: 8 dim: 9 } } }
layer { name: "tanh" type: "TanH" bottom: "b" top: "c" }
layer { name: "relu" type: "ReLU6" bottom: "a" top: "d" }
layer { name: "one" type: "Convolution" bottom: "d" top: "e"
        convolution_param { num_output: 1 kernel_size: 1 weight_filler { type: "xavier" } } }
layer { name: "two" type: "Convolution" bottom: "c" top: "f"
        convolution_param { num_output: 4 kernel_size: 2 weight_filler { type: "xavier" } } }
layer { name: "relu/f" type: "ReLU" bottom: "f" top: "f" }
layer { name: "loss/c" type: "Reduction" bottom: "c" top: "loss/c" loss_weight: 1 reduction_param { operation: SUMSQ } }
layer { name: "loss/d" type: "Reduction" bottom: "d" top: "loss/d" loss_weight: 1 reduction_param { operation: SUMSQ } }
layer { name: "loss/f" type: "Reduction" bottom: "f" top: "loss/f" loss_weight: 1 reduction_param { operation: SUMSQ } }
"""


def test_a_branch_that_keeps_its_shape() -> None:
    """After another input has a new shape, the gradients of a branch are those of its last pass."""
    net = net_of(TWO_BRANCHES)
    rng = np.random.default_rng(0)
    net.forward(a=rng.normal(size=(3, 1, 5, 6)), b=rng.normal(size=(3, 1, 8, 9)))
    before = net.backward()["b"].copy()
    net.blobs["a"].reshape(1, 1, 5, 6)
    net.reshape()
    np.testing.assert_allclose(net.backward()["b"], before, rtol=1e-5)


def test_a_layer_in_place_that_has_run() -> None:
    """A layer behind it that runs again reads what it has written, though the layer before it
    runs again, too.
    """
    net = net_of("""
        layer { name: "x" type: "Input" top: "x" input_param { shape { dim: 3 dim: 2 dim: 8 dim: 8 } } }
        layer { name: "conv" type: "Convolution" bottom: "x" top: "a"
                convolution_param { num_output: 2 kernel_size: 2 weight_filler { type: "xavier" } } }
        layer { name: "norm" type: "BatchNorm" bottom: "a" top: "a" }
        layer { name: "pool" type: "Pooling" bottom: "a" top: "p" pooling_param { kernel_size: 2 stride: 2 } }""")
    rng = np.random.default_rng(0)
    net.forward(x=rng.normal(size=(3, 2, 8, 8)))
    net.blobs["x"].reshape(1, 2, 8, 8)
    net.blobs["x"].data[...] = rng.normal(size=(1, 2, 8, 8))
    before = net.forward()["p"].copy()
    net.reshape()
    net.backward(p=np.ones_like(before))
    np.testing.assert_array_equal(net.blobs["p"].data, before)
