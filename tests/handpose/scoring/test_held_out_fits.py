"""handpose/scoring/held_out.py; more of it in the tests of tools/test.py"""

from __future__ import annotations

from pathlib import Path

import pytest

import netlib
from handpose.scoring.held_out import deploy_of
from netlib.errors import WeightsError
from netlib.proto import prototxt

LEARNED = (
    'layer {{ name: "{0}" type: "InnerProduct" bottom: "{1}" top: "{0}" inner_product_param {{ num_output: 47 }} }} '
)
NET = """
input: "x" input_shape {{ dim: 1 dim: 47 }} {0}
layer {{ name: "hand" type: "HandModel" bottom: "{1}" top: "pred" }}
"""


def test_a_deploy_net_with_a_layer_that_the_weights_lack(tmp_path: Path) -> None:
    """The error names the layer, because a layer with random weights would give meaningless figures."""
    one, two = LEARNED.format("one", "x"), LEARNED.format("two", "one")
    net = netlib.Net(prototxt.parse(NET.format(one, "one")), netlib.TEST)
    net.save(tmp_path / "w.caffemodel.h5")
    for text, top in ((one, "one"), (one + two, "two")):
        (tmp_path / f"{top}.prototxt").write_text(NET.format(text, top))
    deploy_of(net, tmp_path / "one.prototxt", tmp_path / "w.caffemodel.h5")
    with pytest.raises(WeightsError, match=r"w\.caffemodel\.h5: no weights for layer 'two' of net .*; it has "):
        deploy_of(net, tmp_path / "two.prototxt", tmp_path / "w.caffemodel.h5")
