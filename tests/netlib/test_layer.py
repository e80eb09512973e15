"""Layer types, options, Python layers, and helpers for authors of layers."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import netlib
from netlib import gradcheck
from netlib.blob import Blob
from netlib.proto.options import block_name, layer_types
from tests.support.bad_input import bad_inputs
from tests.support.nets import inputs

pytestmark = pytest.mark.both_engines

MakeNet = Callable[..., netlib.Net]

X = inputs(x=(2, 3))

# As in Caffe's examples, except for the import.
DOUBLE = """
import json
import netlib as caffe

class Double(caffe.Layer):
    def setup(self, bottom, top):
        if len(bottom) != 1:
            raise Exception("Need one input.")
        self.factor = json.loads(self.param_str)["factor"] if self.param_str else 2
        self.blobs.add_blob(1)
        self.blobs[0].data[...] = 1

    def reshape(self, bottom, top):
        top[0].reshape(*bottom[0].data.shape)

    def forward(self, bottom, top):
        top[0].data[...] = self.factor * self.blobs[0].data * bottom[0].data + (self.phase == caffe.TEST)

    def backward(self, top, propagate_down, bottom):
        self.blobs[0].diff[...] += (self.factor * bottom[0].data * top[0].diff).sum()
        if propagate_down[0]:
            bottom[0].diff[...] = self.factor * self.blobs[0].data * top[0].diff"""


def python(param: str) -> str:
    """Return a net with a Python layer."""
    return X + f'layer {{ name: "p" type: "Python" bottom: "x" top: "y" python_param {{ {param} }} }}'


@pytest.fixture
def module(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    """Write a module with the layer ``Double`` to the import path and return its name."""
    name = f"double_{abs(hash(tmp_path))}"
    (tmp_path / f"{name}.py").write_text(DOUBLE)
    monkeypatch.syspath_prepend(tmp_path)
    return name


@pytest.mark.parametrize(("param_str", "factor"), [("", 2), ("param_str: '{\"factor\": 5}'", 5)])
def test_a_caffe_python_layer_runs(net_of: MakeNet, module: str, param_str: str, factor: int) -> None:
    """A Caffe Python layer with param_str, phase and self.blobs.add_blob runs forward and backward."""
    net = net_of("force_backward: true " + python(f'module: "{module}" layer: "Double" {param_str}'))
    x = np.arange(6.0).reshape(2, 3)
    assert np.array_equal(net.forward(x=x)["y"], factor * x)
    net.backward(y=np.ones((2, 3)))
    assert (net.blobs["x"].diff == factor).all()
    assert net.params["p"][0].diff.tolist() == [factor * 15]
    assert [p.label for p in net.learnable] == ["p/0"]


def test_a_python_layer_knows_its_phase(net_of: MakeNet, module: str) -> None:
    """self.phase is netlib.TRAIN or netlib.TEST."""
    net = net_of(python(f'module: "{module}" layer: "Double"'), netlib.TEST)
    assert (net.forward()["y"] == 1).all()


def test_a_python_layer_can_be_checked(module: str) -> None:
    """The gradient check accepts a Python layer."""
    x = np.random.default_rng(0).normal(size=(2, 3))
    layer = gradcheck.make_layer(f'type: "Python" python_param {{ module: "{module}" layer: "Double" }}', [x])
    gradcheck.check(layer, [x])


@bad_inputs(netlib.PrototxtError, {
    'module: "MODULE"': "net.prototxt:1:151: error: missing required field 'layer' in python_param",
    'modul: "MODULE" layer: "Double"': "net.prototxt:1:153: error: unknown field 'modul' (did you mean 'module'?)",
})
def test_mistakes_in_python_param(net_of: MakeNet, module: str, given: str, rejected: Any) -> None:
    """Errors in python_param have the position in the prototxt."""
    with rejected:
        net_of(python(given.replace("MODULE", module)))


def test_the_names_of_option_blocks() -> None:
    """The name is the type in snake case, as in caffe.proto."""
    found = {name: block_name(cls, name) for name, cls in layer_types().items()}
    assert found["InnerProduct"] == "inner_product_param"
    assert found["HDF5Data"] == "hdf5_data_param"
    assert found["ReLU"] == "relu_param"
    assert found["TanH"] == "tanh_param"
    assert found["SoftmaxWithLoss"] == "softmax_param"
    assert found["PhysLimit"] == found["DeepHandModelDofConstraintLoss"] == "phys_limit_param"
    assert found["Convolution"] == "convolution_param"


def test_layer_type_list() -> None:
    """The list is sorted and includes Python."""
    types = netlib.layer_type_list()
    assert types == sorted(types)
    assert {"Convolution", "HandModel", "DeepHandModel", "Python"} <= set(types)


def test_helpers_for_layer_authors() -> None:
    """canonical_axis resolves negative axes; fail adds the position of an option."""
    layer = gradcheck.make_layer('name: "p" type: "Power" power_param { scale: 2 }', [np.zeros(3)])
    assert [layer.canonical_axis(a, Blob((2, 3, 4))) for a in (0, 2, -1, -3)] == [0, 2, 2, 0]
    with pytest.raises(netlib.LayerError, match=r"layer 'p': axis 3 is out of range for a blob of 3 axes \(2, 3, 4\)"):
        layer.canonical_axis(3, Blob((2, 3, 4)))
    assert str(layer.fail("says", "scale")) == "<gradcheck>:1:39: error: layer 'p': says"


def test_state_and_restore_rewind_the_random_stream() -> None:
    """The state holds plain numbers and strings, so that JSON can store it."""
    from netlib.snapshots.snapshot import as_plain

    layer: Any = gradcheck.make_layer('type: "Dropout"', [np.zeros(3)])
    state = as_plain(layer.state())
    first = layer.rng.random(5)
    layer.restore(state)
    assert np.array_equal(layer.rng.random(5), first)
