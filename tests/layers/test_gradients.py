"""Gradients of options and shapes whose computation no case of support/layer_cases.py and no
recording of Caffe has.
"""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from layers import LAYER_TYPES
from netlib import gradcheck
from netlib.layer import Layer
from tests.support.layer_cases import off_zero
from tests.support.tables import lines_of, shape_of


def array_of(word: str) -> np.ndarray:
    """Values in JSON, or random values of a shape."""
    if word[0] == "[":
        return np.array(json.loads(word))
    values = off_zero(*shape_of(word.removeprefix("+")))
    return np.abs(values) if word[0] == "+" else values


def with_random_parameters(layer: Layer) -> Layer:
    """The layer; parameters that are not learned, such as statistics, are unchanged."""
    rates = [param.lr_mult for param in layer.spec.param] or [1.0] * len(layer.blobs)
    for blob, rate in zip(layer.blobs, rates, strict=True):
        if rate:
            blob.data[...] = off_zero(*blob.shape)
    return layer


@pytest.mark.parametrize("row", lines_of(Path(__file__).with_name("gradients.txt")), ids=" ".join)
def test_the_gradient_agrees_with_differences(row: list[str]) -> None:
    """Also in place, where the layer supports it."""
    text, bottoms, numbers = row if len(row) == 3 else (*row, "")
    kind, _, options = text.partition(" ")
    arrays = [array_of(word) for word in bottoms.split()]
    wanted = [not numbers or str(i) in numbers.split() for i in range(len(arrays))]
    in_place = LAYER_TYPES[kind].in_place and "negative_slope: -" not in options
    for together in {False, in_place}:
        layer = with_random_parameters(gradcheck.make_layer(f'type: "{kind}" {options}', arrays))
        gradcheck.check(layer, arrays, wanted=wanted, in_place=together)
