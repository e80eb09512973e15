"""What losses over labels share: layers/loss/labels.py."""

import numpy as np
import pytest

import netlib
from layers.loss import labels
from netlib.proto import prototxt, schema
from netlib.proto.messages import LossParameter

pytestmark = pytest.mark.both_engines


def loss_param(text):
    """As it stands in a layer."""
    return schema.read(prototxt.parse(text, "<test>"), LossParameter)


@pytest.mark.parametrize(
    ("text", "default", "expected"),
    [("", "VALID", "VALID"), ("", "BATCH_SIZE", "BATCH_SIZE"), ("normalize: true", "BATCH_SIZE", "VALID"),
     ("normalize: false", "VALID", "BATCH_SIZE"), ("normalization: NONE", "BATCH_SIZE", "NONE"),
     ("normalization: VALID normalize: false", "BATCH_SIZE", "VALID")],
)  # fmt: skip
def test_normalization(text, default, expected):
    """The newer field, else the older one, else the default of the layer type."""
    assert labels.normalization(loss_param(text), default) == expected


@pytest.mark.parametrize(("name", "expected"), [("VALID", 3), ("FULL", 4), ("BATCH_SIZE", 2), ("NONE", 1)])
def test_divisor(name, expected):
    """3 of 4 labels count, in 2 items; never less than 1."""
    assert labels.divisor(name, np.array([True, False, True, True]), 2) == expected
    assert labels.divisor(name, np.zeros(0, bool), 0) == 1


def test_which_labels_count():
    """Cut to a whole number first; NaN is not ignored, so that it is found."""
    values = np.array([0, 0.9, -0.9, 1, -1, np.nan])
    assert labels.counted(values, None).all()
    assert labels.counted(values, 0)[:5].tolist() == [False, False, False, True, True]
    assert labels.counted(values, 255).all()


@pytest.mark.parametrize("label", [3, -1, 1e9, float("nan"), float("inf"), float("-inf")])
@pytest.mark.parametrize("type_name", ["SoftmaxWithLoss", "HingeLoss", "MultinomialLogisticLoss", "Accuracy"])
def test_what_is_no_class(run, type_name, label):
    """Not even NaN passes for a label."""
    with pytest.raises(
        netlib.LayerError, match=rf"label {label:.9g} in 'bottom1'; expected 0 to 2".replace("+", r"\+")
    ):
        run(f'type: "{type_name}"', np.ones((2, 3)), [0, label])


@pytest.mark.parametrize(
    ("type_name", "target"),
    [("SoftmaxWithLoss", [0, 1]), ("HingeLoss", [0, 1]), ("MultinomialLogisticLoss", [0, 1]),
     ("SigmoidCrossEntropyLoss", np.zeros((2, 3)))],
)  # fmt: skip
def test_labels_have_no_gradient(run, type_name, target):
    """And the layer says so when it is asked for one."""
    with pytest.raises(netlib.LayerError, match=r"has no gradient for its .*; set propagate_down: false for them"):
        run(f'type: "{type_name}"', np.ones((2, 3)), target).backward(1)
