"""backward before forward, as in pycaffe's test_python_layer: layers that have not run are run
forwards once, and what has run is not run again.
"""

from __future__ import annotations

import numpy as np
import pytest

import netlib
from netlib.proto import prototxt
from tests.support.nets import X

pytestmark = pytest.mark.both_engines

LINEAR = """
layer { name: "%s" type: "InnerProduct" bottom: "%s" top: "%s"
  inner_product_param { num_output: 2 weight_filler { type: "constant" value: 1 } } }
"""
DROPOUT = 'layer { name: "k" type: "Dropout" bottom: "y" top: "y" } '
ROWS = 'layer { name: "k" type: "DummyData" top: "x" dummy_data_param { shape { dim: 4 dim: 3 } } }'
A, B = LINEAR % ("a", "x", "y"), LINEAR % ("b", "y", "z")


def net_of(text: str) -> netlib.Net:
    return netlib.Net(prototxt.parse("force_backward: true " + text), netlib.TRAIN, seed=1)


@pytest.mark.parametrize("before", [0, 7])
def test_the_layers_run_once(before: int) -> None:
    """Also after a pass with another batch size; the diff of the top is the caller's."""
    net = net_of(X + A + B)
    if before:
        net.forward(x=np.full((before, 3), 8))
        net.blobs["x"].reshape(2, 3)
        net.reshape()
    net.blobs["x"].data[...] = 5
    assert (net.backward(z=np.ones((2, 2)))["x"] == 4).all()
    slopes = [param.blob.diff.max() for param in net.learnable if param.blob.diff.ndim == 2]
    assert slopes == [2 * 5 * 2, 3 * 5 * 2]


def test_layers_that_have_run_are_not_run_again() -> None:
    """A layer before it runs once, but what others have read keeps its values."""
    net = net_of(X + A + DROPOUT + B)
    net.blobs["y"].data[...] = 3
    net.forward(start="k", end="k")
    y = net.blobs["y"].data.copy()
    dx = net.backward(z=np.ones((2, 2)))["x"]
    assert (net.blobs["z"].data[:, 0] == y.sum(axis=1)).all()
    assert (dx[:, 0] == 2 * (y / 3).sum(axis=1)).all()


@pytest.mark.parametrize(
    ("text", "what"), [(X + A + DROPOUT, "draws random numbers"), (ROWS + A, "reads data")]
)
def test_a_pass_that_changes_the_next_one_must_be_run_first(text: str, what: str) -> None:
    tried, fresh = net_of(text), net_of(text)
    with pytest.raises(netlib.LayerError, match=f"'k': backward was called before.* {what}: run"):
        tried.backward()
    assert (tried.forward()["y"] == fresh.forward()["y"]).all()
