"""backward before forward, which Caffe leaves undefined: an error, and nothing is computed."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

import netlib
from netlib.proto import prototxt

pytestmark = pytest.mark.both_engines

X = 'layer { name: "x" type: "Input" top: "x" input_param { shape { dim: 2 dim: 3 } } }'
LINEAR = (
    'layer { name: "%s" type: "InnerProduct" bottom: "%s" top: "%s" '
    'inner_product_param { num_output: 2 weight_filler { type: "constant" value: %g } } }'
)
CHAIN = X + LINEAR % ("a", "x", "y", 3) + LINEAR % ("b", "y", "z", 5)  # dx = 2 * 2 * 3 * 5 = 60 for dz = 1
DROPOUT = 'layer { name: "k" type: "Dropout" bottom: "x" top: "r" }'


def net_of(text: str) -> netlib.Net:
    return netlib.Net(prototxt.parse("force_backward: true " + text), netlib.TRAIN, seed=1)


def reshaped(net: netlib.Net) -> None:
    net.forward()
    net.blobs["x"].reshape(5, 3)


BEFORE: dict[str, tuple[Callable[[netlib.Net], object], str]] = {
    "nothing": (lambda net: None, "a"),
    "the last layer": (lambda net: net.forward(start="b"), "a"),
    "the first layers": (lambda net: net.forward(end="a"), "b"),
    "another shape": (reshaped, "a"),
}


@pytest.mark.parametrize("before", list(BEFORE))
def test_a_layer_that_has_not_run_is_named(before: str) -> None:
    net, (act, name) = net_of(CHAIN), BEFORE[before]
    act(net)
    message = rf"layer '{name}': backward needs a forward pass with the current shapes: run forward first$"
    for _ in range(2):
        with pytest.raises(netlib.LayerError, match=message):
            net.backward()
    net.forward()
    np.testing.assert_allclose(net.backward(z=np.ones((net.blobs["x"].shape[0], 2)))["x"], 60)


def test_a_part_that_has_run_has_a_backward_pass() -> None:
    net = net_of(CHAIN)
    net.forward(end="a")
    net.blobs["y"].diff[...] = 1
    np.testing.assert_allclose(net.backward(start="a")["x"], 6)


def test_a_pass_layer_by_layer_is_complete() -> None:
    net = net_of(X + DROPOUT + LINEAR % ("b", "r", "z", 1))
    net.forward()
    net.blobs["x"].reshape(6, 3)
    net.blobs["x"].data[...] = 1
    for name in net.layer_dict:
        net.forward(start=name, end=name)
    net.reshape()
    mask = net.blobs["r"].data.copy()
    np.testing.assert_allclose(net.backward(z=np.ones((6, 2)))["x"], 2 * mask)
    np.testing.assert_array_equal(net.blobs["r"].data, mask)
