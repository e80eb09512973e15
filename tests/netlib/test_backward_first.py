"""backward before forward: layers that have not run are run forwards once, and what has run is not run again."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import netlib
from netlib.proto import prototxt
from tests.layers.test_conformance import CASES, LAYER_TYPES

pytestmark = pytest.mark.both_engines

X = 'layer { name: "x" type: "Input" top: "x" input_param { shape { dim: 2 dim: 3 } } }'
LINEAR = (
    'layer { name: "%s" type: "InnerProduct" bottom: "%s" top: "%s" '
    'inner_product_param { num_output: 2 weight_filler { type: "constant" value: %g } } }'
)
CHAIN = X + LINEAR % ("a", "x", "y", 3) + LINEAR % ("b", "y", "z", 5)  # dx = 2 * 2 * 3 * 5 = 60 for dz = 1


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
    "backward": lambda net: net.backward(),
}


@pytest.mark.parametrize("before", list(BEFORE))
def test_the_gradient_of_a_linear_net_is_the_same_whatever_has_run(before: str) -> None:
    net = net_of(CHAIN)
    BEFORE[before](net)
    dx = net.backward(z=np.ones((net.blobs["x"].shape[0], 2)))["x"]
    assert dx.shape == net.blobs["x"].shape
    np.testing.assert_allclose(dx, 60)


def test_a_blob_reshaped_by_the_caller_is_propagated_first() -> None:
    net = net_of(CHAIN)
    net.forward()
    net.blobs["x"].reshape(7, 3)
    assert net.backward()["x"].shape == (7, 3)
    assert net.blobs["z"].diff.shape == (7, 2)


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
    """After forward(start=...), backward runs the layers before it once, but not over what the others have read."""
    net = net_of(
        X + LINEAR % ("a", "x", "y", 1) + layer("ReLU", bottom='bottom: "y"', top="r") + LINEAR % ("b", "r", "z", 1)
    )
    net.blobs["y"].data[...] = [[1, -1], [0, 2]]
    net.forward(start="k")
    np.testing.assert_allclose(net.blobs["z"].data, [[1, 1], [2, 2]])
    np.testing.assert_allclose(net.backward(z=np.ones((2, 2)))["x"], [[2] * 3] * 2)
    np.testing.assert_allclose(net.blobs["y"].data, [[1, -1], [0, 2]])


def test_a_pass_layer_by_layer_is_complete() -> None:
    """Layers that run one by one with new shapes have all run: the mask of a Dropout is not drawn again."""
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


def test_a_part_that_has_run_is_not_run_again() -> None:
    """After a part with a new batch size, a full backward runs the rest and keeps the mask of the part."""
    net = net_of(X + layer("Dropout", top="r") + LINEAR % ("b", "r", "z", 1))
    net.forward()
    net.blobs["x"].reshape(6, 3)
    net.blobs["x"].data[...] = 1
    net.forward(end="k")
    net.reshape()
    mask = net.blobs["r"].data.copy()
    np.testing.assert_allclose(net.backward(z=np.ones((6, 2)))["x"], 2 * mask)
    np.testing.assert_allclose(net.blobs["r"].data, mask)


@pytest.mark.parametrize("kind", ["BNLL", "ELU", "EuclideanLoss", "Exp", "LRN", "Normalize", "PReLU", "Pooling"])
def test_the_gradient_is_that_after_a_forward_pass(kind: str) -> None:
    options, make_bottoms, more = CASES[kind]
    assert kind in LAYER_TYPES
    bottoms = [np.asarray(x) for x in make_bottoms(2)]
    names = [f"x{i}" for i in range(len(bottoms))]
    text = "".join(
        f'layer {{ name: "{name}" type: "Input" top: "{name}" input_param {{ shape {{ '
        f'{" ".join(f"dim: {n}" for n in x.shape)} }} }} }}' for name, x in zip(names, bottoms)
    )
    text += layer(kind, options, " ".join(f'bottom: "{name}"' for name in names))
    assert more.get("tops", 1) == 1
    found = []
    for is_first in (True, False):
        net = net_of(text)
        for name, x in zip(names, bottoms):
            net.blobs[name].data[...] = x
        if not is_first:
            net.forward()
        net.blobs["y"].diff[...] = np.random.default_rng(0).normal(size=net.blobs["y"].shape)
        found.append(net.backward())
    for name in names:
        np.testing.assert_array_equal(found[0][name], found[1][name])


RANDOM = {
    "draws random numbers": X + layer("Dropout"),
    "reads data": 'layer { name: "k" type: "DummyData" top: "x" dummy_data_param { shape { dim: 4 dim: 3 } } }'
    + LINEAR % ("a", "x", "y", 1),
}


@pytest.mark.parametrize("what", list(RANDOM))
def test_a_net_whose_forward_pass_changes_the_next_one_needs_forward_first(what: str) -> None:
    net, other = net_of(RANDOM[what]), net_of(RANDOM[what])
    with pytest.raises(netlib.LayerError, match=rf"layer 'k': backward was called before forward, which {what}: run"):
        net.backward()
    np.testing.assert_array_equal(net.forward()["y"], other.forward()["y"])
    net.backward()


def test_a_python_layer(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "squared.py").write_text(
        "import caffe\n"
        "class Squared(caffe.Layer):\n"
        "    def setup(self, bottom, top): pass\n"
        "    def reshape(self, bottom, top): top[0].reshape(*bottom[0].data.shape)\n"
        "    def forward(self, bottom, top): self.x = bottom[0].data.copy()\n"
        "    def backward(self, top, propagate_down, bottom): bottom[0].diff[...] = 2 * self.x * top[0].diff\n"
    )
    monkeypatch.syspath_prepend(tmp_path)
    net = net_of(X + layer("Python", 'python_param { module: "squared" layer: "Squared" }'))
    net.blobs["x"].data[...] = 5
    net.blobs["y"].diff[...] = 7
    net.backward()
    assert (net.blobs["x"].diff == 70).all()
