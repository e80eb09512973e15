"""Option blocks that a layer type does not read."""

from __future__ import annotations

import pytest

import netlib
from netlib.proto import prototxt
from tests.support.nets import inputs

X, T = inputs(x=(2, 3)), inputs(t=(2,))


@pytest.mark.parametrize(
    ("kind", "block"),
    [
        ("HingeLoss", "loss_param { ignore_label: 1 }"),
        ("MultinomialLogisticLoss", "loss_param { normalization: FULL }"),
        ("SoftmaxWithLoss", "transform_param { scale: 2 }"),
        ("Accuracy", "loss_param { ignore_label: 1 }"),
    ],
)
def test_a_block_that_the_type_does_not_read_is_a_warning(
    kind: str, block: str, caplog: pytest.LogCaptureFixture
) -> None:
    layer = f'layer {{ name: "k" type: "{kind}" bottom: "x" bottom: "t" top: "k" {block} }}'
    netlib.Net(prototxt.parse(X + T + layer, "net"), netlib.TRAIN)
    [message] = [r.message for r in caplog.records if r.levelname == "WARNING"]
    assert message.startswith("net:1:")
    assert (
        f"layer 'k': {kind} does not read {block.split()[0]}; it is ignored, as in Caffe" in message
    )


def test_a_mistake_in_a_block_that_the_type_does_not_read() -> None:
    """It is an error when the net is built, as in Caffe, and not hours later in the
    first snapshot.
    """
    layer = 'layer { name: "k" type: "HingeLoss" bottom: "x" bottom: "t" top: "k" dropout_param { ratio: 0.3 } }'
    with pytest.raises(
        netlib.PrototxtError,
        match=r"^net:1:\d+: error: unknown field 'ratio'; known fields: dropout_",
    ):
        netlib.Net(prototxt.parse(X + T + layer, "net"), netlib.TRAIN)


@pytest.mark.parametrize("kind", ["SoftmaxWithLoss", "SigmoidCrossEntropyLoss"])
def test_a_block_that_the_type_reads_is_silent(kind: str, caplog: pytest.LogCaptureFixture) -> None:
    second = "t" if kind == "SoftmaxWithLoss" else "x"
    layer = f'layer {{ type: "{kind}" bottom: "x" bottom: "{second}" top: "k" loss_param {{ ignore_label: 1 }} }}'
    netlib.Net(prototxt.parse(X + T + layer), netlib.TRAIN)
    assert not [r for r in caplog.records if r.levelname == "WARNING"]
