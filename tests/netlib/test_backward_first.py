"""backward before forward, as in pycaffe's test_python_layer: layers that have not run are run
forwards once, and what has run is not run again.
"""

from __future__ import annotations

import numpy as np
import pytest

import netlib
from netlib.proto import prototxt
from tests.support.nets import X, inputs

pytestmark = pytest.mark.both_engines

ONES = 'num_output: 2 weight_filler { type: "constant" value: 1 }'


def net_of(text: str) -> netlib.Net:
    return netlib.Net(prototxt.parse("force_backward: true " + text), netlib.TRAIN, seed=1)


def layer(name: str, kind: str, bottom: str, top: str, options: str = "") -> str:
    return f'layer {{ name: "{name}" type: "{kind}" bottom: "{bottom}" top: "{top}" {options} }} '


def linear(name: str, bottom: str, top: str) -> str:
    return layer(name, "InnerProduct", bottom, top, f"inner_product_param {{ {ONES} }}")


def convolution(name: str, bottom: str, top: str) -> str:
    options = f"convolution_param {{ {ONES} kernel_size: 1 }}"
    return layer(name, "Convolution", bottom, top, options)


@pytest.mark.parametrize("items", [2, 7])
def test_the_layers_run_once(items: int) -> None:
    """Also after a pass with another batch size; the diff of the top is the caller's."""
    net = net_of(X + linear("a", "x", "y") + linear("b", "y", "z"))
    if items != 2:
        net.forward()
        net.blobs["x"].reshape(items, 3)
        net.blobs["z"].reshape(items, 2)
    net.blobs["x"].data[...] = 5
    net.blobs["z"].diff[...] = 1
    assert (net.backward()["x"] == 4).all()
    assert (net.params["a"][0].diff == 2 * 5 * items).all()
    assert (net.params["b"][0].diff == 3 * 5 * items).all()


def test_layers_that_have_run_are_not_run_again() -> None:
    """A layer before it runs once, but what others have read keeps its values."""
    drop = layer("drop", "Dropout", "y", "y")
    net = net_of(X + linear("a", "x", "y") + drop + linear("b", "y", "z"))
    net.blobs["y"].data[...] = 3
    net.forward(start="drop", end="drop")
    y = net.blobs["y"].data.copy()
    dx = net.backward(z=np.ones((2, 2)))["x"]
    np.testing.assert_array_equal(net.blobs["y"].data, y)
    np.testing.assert_array_equal(net.blobs["z"].data[:, 0], y.sum(axis=1))
    np.testing.assert_array_equal(dx[:, 0], 2 * (y / 3).sum(axis=1))


def test_a_branch_whose_shapes_stay_keeps_its_pass(rng: np.random.Generator) -> None:
    """After another input has a new shape, its gradients are those of its last pass."""
    text = inputs(a=(3, 1, 4, 4), b=(3, 1, 4, 4)) + layer("tanh", "TanH", "b", "c")
    text += convolution("d", "a", "d")
    text += convolution("e", "c", "e")
    text += layer("sum", "Reduction", "d", "sum", "loss_weight: 1")
    text += layer("total", "Reduction", "e", "total", "loss_weight: 1")
    net = net_of(text)
    net.forward(b=rng.normal(size=(3, 1, 4, 4)))
    before = net.backward()["b"].copy()
    net.blobs["a"].reshape(1, 1, 4, 4)
    net.reshape()
    np.testing.assert_allclose(net.backward()["b"], before, rtol=1e-5)


DUMMY = (
    'layer { name: "k" type: "DummyData" top: "x" dummy_data_param { shape { dim: 4 dim: 3 } } } '
)
CHANGING = {
    "draws random numbers": X + layer("k", "Dropout", "x", "y"),
    "reads data": DUMMY + linear("a", "x", "y"),
}


@pytest.mark.parametrize("what", CHANGING)
def test_a_pass_that_changes_the_next_one_must_be_run_first(what: str) -> None:
    nets = [net_of(CHANGING[what]) for _ in range(2)]
    for net in nets:
        net.blobs["x"].data[...] = 1
    with pytest.raises(
        netlib.LayerError, match=f"'k': backward was called before forward, which {what}: run"
    ):
        nets[0].backward()
    first, other = (net.forward()["y"] for net in nets)
    np.testing.assert_array_equal(first, other)


def test_a_layer_whose_forward_fails_runs_again(monkeypatch: pytest.MonkeyPatch) -> None:
    """The slopes of tanh are those of the new input, not of the last pass that was complete."""
    net = net_of(X + layer("k", "TanH", "x", "y"))
    shape = net.blobs["x"].shape
    net.forward(x=np.full(shape, 3))

    def fail(*args: object) -> None:
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(net.layer_dict["k"], "forward", fail)
        with pytest.raises(KeyboardInterrupt):
            net.forward(x=np.zeros(shape))
    np.testing.assert_allclose(net.backward(y=np.ones(shape))["x"], 1)


def test_a_temporary_change_of_size_discards_the_values() -> None:
    """Backward runs the layers again with the current input, 0."""
    net = net_of(X + layer("k", "TanH", "x", "y") + layer("s", "Softmax", "y", "z"))
    net.forward(x=np.full((2, 3), 3))
    for items in (5, 2):
        net.blobs["x"].reshape(items, 3)
        net.reshape()
    dx = net.backward(z=[[9, 0, 0]] * 2)["x"]  # dx = p (dz - sum of p dz) for p = 1/3 everywhere
    np.testing.assert_allclose(dx, [[2, -1, -1]] * 2, rtol=1e-6)
