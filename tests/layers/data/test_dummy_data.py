"""DummyData."""

import numpy as np
import pytest

import netlib
from tests.support.bad_input import bad_inputs


def data(options, tops=1):
    names = " ".join(f'top: "{"ab"[i]}"' for i in range(tops))
    return f'layer {{ name: "d" type: "DummyData" {names} dummy_data_param {{ {options} }} }}'


@pytest.mark.parametrize(("options", "values"), [
    ("shape { dim: 2 dim: 3 } data_filler { value: 1.5 }", [[[1.5] * 3] * 2] * 2),
    ("shape { dim: 2 } data_filler { value: 1 } data_filler { value: 2 }", [[1, 1], [2, 2]]),
    ("shape { dim: 1 } shape { dim: 2 }", [[0], [0, 0]]),
    ("num: 1 channels: 2 height: 1 width: 1", [[[[[0]], [[0]]]]] * 2),
    ("num: 1 num: 2 channels: 1 height: 1 width: 1", [[[[[0]]]], [[[[0]]], [[[0]]]]]),
])
def test_shapes_and_values_for_each_top_or_for_all(net_of, options, values):
    """Shapes and fillers apply to one top each or to all; the default is 0, and four sizes may replace a shape."""
    net = net_of(data(options, tops=2))
    net.forward()
    assert [net.blobs[name].data.tolist() for name in "ab"] == values


def test_random_values_are_new_in_every_batch(net_of):
    net = net_of(data('shape { dim: 50 } data_filler { type: "gaussian" } data_filler { value: 3 }', tops=2))
    first = net.forward()["a"].copy()
    assert not np.array_equal(net.forward()["a"], first)
    assert (net.blobs["b"].data == 3).all()


@bad_inputs(netlib.LayerError, {
    "": "net.prototxt:1:7: error: layer 'd': has 3 tops, but 0 of shape",
    "shape { } shape { }": "net.prototxt:1:...: error: layer 'd': has 3 tops, but 2 of shape",
    "shape { } data_filler { } data_filler { }":
        "net.prototxt:1:...: error: layer 'd': has 3 tops, but 2 of data_filler",
    "num: 1 num: 2 channels: 1 height: 1 width: 1": "net.prototxt:1:...: error: layer 'd': has 3 tops, but 2 of num",
    "num: 1 channels: 1 width: 1": "net.prototxt:1:7: error: layer 'd': has 3 tops, but 0 of height",
    "shape { } num: 1 channels: 1 height: 1 width: 1":
        "net.prototxt:1:...: error: layer 'd': has both shape and the older num, channels, height, width; expected one",
    "filler": ('shape { dim: 1 } data_filler { type: "gausian" }', netlib.PrototxtError,
               "net.prototxt:1:...: error: unknown filler type 'gausian' (did you mean 'gaussian'?)"),
})
def test_mistakes(net_of, given, rejected):
    with rejected:
        net_of(f'layer {{ name: "d" type: "DummyData" top: "a" top: "b" top: "c" dummy_data_param {{ {given} }} }}')
