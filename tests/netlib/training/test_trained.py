"""netlib/training/trained.py: test nets with weights from a file."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import netlib
from netlib import layer
from netlib.errors import PrototxtError, WeightsError
from netlib.training.trained import trained
from tests.support.nets import inputs

NET = (
    inputs(x=(2, 3))
    + """
layer { name: "ip" type: "InnerProduct" bottom: "x" top: "y"
  inner_product_param { num_output: 4 weight_filler { type: "xavier" } } }
"""
)
ANOTHER = 'layer { name: "more" type: "Bias" bottom: "y" top: "z" }'


@pytest.fixture
def saved(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> netlib.Net:
    """The net in net.prototxt of the working directory; its weights are in net.caffemodel.h5."""
    monkeypatch.chdir(tmp_path)
    Path("net.prototxt").write_text(NET)
    net = netlib.Net("net.prototxt", netlib.TEST, seed=1)
    net.save("net.caffemodel.h5")
    return net


def test_the_weights_are_those_of_the_file(saved: netlib.Net) -> None:
    found = trained("net.prototxt", "net.caffemodel.h5")
    for own, same in zip(found.params["ip"], saved.params["ip"], strict=True):
        np.testing.assert_array_equal(own.data, same.data)


def test_no_initial_values_are_drawn(saved: netlib.Net, monkeypatch: pytest.MonkeyPatch) -> None:
    drawn: list[object] = []
    monkeypatch.setattr(layer, "fill", lambda *args: drawn.append(args))
    trained("net.prototxt", "net.caffemodel.h5")
    assert drawn == []
    netlib.Net("net.prototxt", netlib.TEST)
    assert len(drawn) == 2


def test_an_unknown_filler_is_still_an_error(saved: netlib.Net) -> None:
    Path("net.prototxt").write_text(NET.replace("xavier", "xaver"))
    message = r"unknown filler type 'xaver' \(did you mean 'xavier'\?\)"
    with pytest.raises(PrototxtError, match=message):
        trained("net.prototxt", "net.caffemodel.h5")


def test_a_layer_without_weights_in_the_file_is_an_error(saved: netlib.Net) -> None:
    Path("net.prototxt").write_text(NET + ANOTHER)
    with pytest.raises(WeightsError, match="more"):
        trained("net.prototxt", "net.caffemodel.h5")
