"""Code shared by losses over labels: layers/loss/labels.py."""

import numpy as np
import pytest

from layers.loss import labels
from netlib.proto import prototxt, schema
from netlib.proto.messages import LossParameter


def loss_param(text):
    return schema.read(prototxt.parse(text, "<test>"), LossParameter)


@pytest.mark.parametrize(
    ("text", "default", "expected"),
    [("", "VALID", "VALID"), ("", "BATCH_SIZE", "BATCH_SIZE"), ("normalize: true", "BATCH_SIZE", "VALID"),
     ("normalize: false", "VALID", "BATCH_SIZE"), ("normalization: NONE", "BATCH_SIZE", "NONE"),
     ("normalization: VALID normalize: false", "BATCH_SIZE", "VALID")],
)
def test_normalization(text, default, expected):
    """``normalization`` takes precedence over ``normalize``, then the default of the layer type."""
    assert labels.normalization(loss_param(text), default) == expected


@pytest.mark.parametrize(("name", "expected"), [("VALID", 3), ("FULL", 4), ("BATCH_SIZE", 2), ("NONE", 1)])
def test_divisor(name, expected):
    """The divisor for 3 counted labels of 4 in 2 items agrees, and is at least 1."""
    assert labels.divisor(name, np.array([True, False, True, True]), 2) == expected
    assert labels.divisor(name, np.zeros(0, bool), 0) == 1


def test_which_labels_count():
    """Labels are truncated before they are compared with ignore_label; NaN is never ignored, so that it is detected."""
    values = np.array([0, 0.9, -0.9, 1, -1, np.nan])
    assert labels.counted(values, None).all()
    assert labels.counted(values, 0)[:5].tolist() == [False, False, False, True, True]
    assert labels.counted(values, 255).all()
