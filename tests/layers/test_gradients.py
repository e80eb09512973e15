"""Gradients of options and shapes whose computation no case of support/layer_cases.txt and no
recording of Caffe has.
"""

from __future__ import annotations

from pathlib import Path

import pytest

from layers import LAYER_TYPES
from netlib.layer import Layer
from tests.support.layer_cases import cases_in, off_zero

CASES = cases_in(Path(__file__).with_name("gradients.txt"))


def with_random_parameters(layer: Layer) -> Layer:
    """The layer; parameters that are not learned, such as statistics, are unchanged."""
    rates = [param.lr_mult for param in layer.spec.param] or [1.0] * len(layer.blobs)
    for blob, rate in zip(layer.blobs, rates, strict=True):
        if rate:
            blob.data[...] = off_zero(*blob.shape)
    return layer


@pytest.mark.parametrize("name", list(CASES))
def test_the_gradient_agrees_with_differences(name: str) -> None:
    """Also in place, where the layer supports it."""
    case = CASES[name]
    arrays = case.bottoms(2)
    in_place = LAYER_TYPES[case.kind].in_place and "negative_slope: -" not in case.options
    for together in {False, in_place}:
        case.check(with_random_parameters(case.layer(arrays)), arrays, together)
