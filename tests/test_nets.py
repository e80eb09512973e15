"""prototxt/: the nets that come with the project fit each other"""

from __future__ import annotations

from pathlib import Path

import pytest

from netlib.messages import NetState
from netlib.net_parameter import load_parameter, select_layers
from netlib.schema import Phase

PROTOTXT = Path(__file__).resolve().parents[1] / "prototxt"
LEARNED = {"Convolution": "convolution_param", "InnerProduct": "inner_product_param"}


def learned(net: str, phase: Phase) -> dict[str, str]:
    """How many outputs the layers with weights have, by name."""
    layers = select_layers(load_parameter(PROTOTXT / net), NetState(phase))
    return {
        layer.name: str(layer.blocks[LEARNED[layer.type]].values("num_output")[0])
        for layer in layers
        if layer.type in LEARNED
    }


@pytest.mark.parametrize("net", ["nyu_train_test.prototxt", "synthetic_train_test.prototxt"])
def test_weights_fit_the_net_that_predicts(net: str) -> None:
    """Tests and predictions want the same weights, and a training makes all of them."""
    wanted = learned("nyu_deploy.prototxt", "TEST")
    assert len(wanted) == 6
    assert learned(net, "TEST") == wanted
    assert wanted.items() <= learned(net, "TRAIN").items()


def test_the_locator_that_is_trained_is_the_one_that_looks() -> None:
    """The packaged net has the same layers with weights as the training."""
    wanted = learned("../models/hand_locator/deploy.prototxt", "TEST")
    assert len(wanted) == 6
    assert learned("locator_train_test.prototxt", "TEST") == learned("locator_train_test.prototxt", "TRAIN") == wanted
