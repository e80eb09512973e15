"""Inserted Split layers: their names, positions and loss weights."""

from __future__ import annotations

import re

import pytest

from netlib.proto.messages import LayerParameter
from netlib.proto.net_parameter import insert_splits

pytestmark = pytest.mark.both_engines


def layers_of(text: str, *weights: float) -> list[LayerParameter]:
    """Return the layers of ``name: bottoms > tops; ...``; the first one has these loss weights."""
    layers = []
    for line in text.split("; "):
        name, bottom, top = (part.split() for part in re.split("[:>]", line))
        given = () if layers else weights
        layers.append(LayerParameter(*name, "T", tuple(bottom), tuple(top), loss_weight=given))
    return layers


def shown(layers: list[LayerParameter]) -> str:
    """Return ``name: bottoms > tops; ...``."""
    lines = [[f"{x.name}:", *x.bottom, ">", *x.top] for x in layers]
    return "; ".join(map(" ".join, lines))


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        # a chain
        ("a: > x; b: x > y; c: y >", "a: > x; b: x > y; c: y >"),
        # two readers
        (
            "a: > x; b: x > y; c: x > z",
            "a: > x; x_a_0_split: x > x_a_0_split_0 x_a_0_split_1; "
            "b: x_a_0_split_0 > y; c: x_a_0_split_1 > z",
        ),
        # one layer reads twice
        (
            "a: > x; b: x x > y",
            "a: > x; x_a_0_split: x > x_a_0_split_0 x_a_0_split_1; "
            "b: x_a_0_split_0 x_a_0_split_1 > y",
        ),
        # after a layer in place
        (
            "a: > x; r: x > x; b: x > y; c: x > z",
            "a: > x; r: x > x; x_r_0_split: x > x_r_0_split_0 x_r_0_split_1; "
            "b: x_r_0_split_0 > y; c: x_r_0_split_1 > z",
        ),
        # the second top
        (
            "a: > x y; b: x y > p; c: y > q",
            "a: > x y; y_a_1_split: y > y_a_1_split_0 y_a_1_split_1; "
            "b: x y_a_1_split_0 > p; c: y_a_1_split_1 > q",
        ),
    ],
)
def test_each_reader_gets_a_copy(text: str, expected: str) -> None:
    """A Split has Caffe's name and follows the last layer that writes the blob
    before its readers.
    """
    assert shown(insert_splits(layers_of(text))) == expected


def test_a_loss_weight_is_one_more_reader() -> None:
    """The loss weight moves from the layer to the first copy."""
    layers = insert_splits(layers_of("a: > x; b: x > y", 2.0))
    assert [x.loss_weight for x in layers] == [(0.0,), (2.0, 0.0), ()]
    assert shown(layers[2:]) == "b: x_a_0_split_1 > y"


def test_a_loss_weight_without_readers_stays() -> None:
    layers = layers_of("a: > x", 2.0)
    assert insert_splits(layers) == layers
