"""Caffe's binary snapshots: their content, and one-line errors for damaged files."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import netlib
from netlib.errors import WeightsError
from netlib.proto import prototxt, schema, wire
from netlib.proto.messages import NetParameter
from netlib.proto.upgrade import AnyNetParameter
from netlib.snapshots import binary_format
from netlib.snapshots.solver_state import SolverState
from netlib.snapshots.weights import image

NET = """
    name: "n"
    layer { name: "x" type: "Input" top: "x" input_param { shape { dim: 2 dim: 3 } } }
    layer { name: "a" type: "InnerProduct" bottom: "x" top: "a" param { name: "w" lr_mult: 2 }
            inner_product_param { num_output: 3 weight_filler { type: "xavier" } } }
    layer { name: "b" type: "InnerProduct" bottom: "a" top: "b" param { name: "w" }
            inner_product_param { num_output: 3 bias_term: false } }
    layer { name: "loss" type: "EuclideanLoss" bottom: "b" bottom: "x" top: "loss" }
"""


@pytest.fixture
def net(net_of: Callable[..., netlib.Net]) -> netlib.Net:
    return net_of(NET)


def layers_of(data: bytes) -> NetParameter:
    return schema.read(wire.decode(data, NetParameter), NetParameter)


def test_a_file_of_weights_is_the_net_with_its_blobs(net: netlib.Net) -> None:
    """A file has all layers, including Split layers, and a shared parameter in each of its
    layers, as in Caffe.
    """
    found = layers_of(image(net, "w.caffemodel"))
    assert found.name == "n"
    assert [layer.name for layer in found.layer] == ["x", "x_x_0_split", "a", "b", "loss"]
    by_name = {layer.name: layer for layer in found.layer}
    assert by_name["a"].param[0].lr_mult == 2
    assert str(by_name["b"].blocks["inner_product_param"]) == "num_output: 3\nbias_term: false\n"
    shapes = {name: [blob.shape.dim for blob in layer.blobs] for name, layer in by_name.items()}  # type: ignore[union-attr]
    assert shapes == {"x": [], "x_x_0_split": [], "a": [(3, 3), (3,)], "b": [(3, 3)], "loss": []}
    weights = binary_format.read_weights(image(net, "w.caffemodel"), "w")
    assert np.array_equal(weights["b"][0], net.params["a"][0].data)


def test_gradients_if_asked_for(net: netlib.Net) -> None:
    net.params["a"][1].diff[...] = 7
    without, with_diffs = (
        layers_of(image(net, "w", diffs)).layer[2].blobs[1] for diffs in (False, True)
    )
    assert without.diff is None
    assert with_diffs.diff is not None
    assert with_diffs.diff.tolist() == [7, 7, 7]


def test_double_precision_stays(net_of: Callable[..., netlib.Net]) -> None:
    net = net_of(NET, dtype=np.float64)
    net.params["a"][0].data[...] = 1 / 3
    found = binary_format.read_weights(image(net, "w"), "w")["a"][0]
    assert found.dtype == np.float64
    assert (found == 1 / 3).all()


def test_weights_too_large_for_caffe_are_rejected(
    net: netlib.Net, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(binary_format, "MAX_BYTES", 100)
    with pytest.raises(WeightsError, match=r"Caffe's binary format, 2 GB; .*HDF5.*\.h5"):
        image(net, "w.caffemodel")


def test_weights_of_an_unknown_layer_type_are_copied_by_name(
    net: netlib.Net, tmp_path: Path
) -> None:
    """In the format of Caffe and in that of 2014."""
    blobs = "blobs { num: 1 channels: 1 height: 3 width: 3 data: [1, 2, 3, 4, 5, 6, 7, 8, 9] }"
    blobs += "blobs { shape { dim: 3 } data: [1, 2, 3] }"
    for text in ('layer { name: "a" type: "Own" %s }', 'layers { name: "a" type: 5 %s }'):
        image = wire.encode(prototxt.parse(text % blobs), AnyNetParameter)
        (tmp_path / "w.caffemodel").write_bytes(image.replace(b"\x28\x05", b"\x28\x63"))
        net.params["a"][0].data[...] = 0
        net.copy_from(tmp_path / "w.caffemodel")
        assert net.params["a"][0].data.ravel().tolist() == list(range(1, 10))


def test_a_state_that_lost_its_end_is_refused() -> None:
    """A truncated state is rejected at every length; none is taken for a state of Caffe, which
    has no checksum.
    """
    state = SolverState(2, 1, "w.caffemodel", [np.ones((2, 3), np.float32)], {"checksum": 7})
    whole = binary_format.state_image(state)
    for length in range(1, len(whole)):
        with pytest.raises(
            WeightsError, match=r"^s\.solverstate: .*; expected a solver state \(\.solverstate\)"
        ):
            binary_format.read_state(whole[:length], "s.solverstate")
