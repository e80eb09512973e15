"""Inserted Split layers: their names, positions and loss weights."""

from __future__ import annotations

import pytest

from netlib.proto.messages import LayerParameter
from netlib.proto.net_parameter import insert_splits

pytestmark = pytest.mark.both_engines


def layer(
    name: str, bottom: str = "", top: str = "", weights: tuple[float, ...] = ()
) -> LayerParameter:
    """Return a layer whose blobs are given as names separated by spaces."""
    return LayerParameter(
        name=name,
        type="T",
        bottom=tuple(bottom.split()),
        top=tuple(top.split()),
        loss_weight=weights,
    )


def shown(layers: list[LayerParameter]) -> list[str]:
    """Return ``name: bottoms > tops`` for every layer."""
    return [f"{x.name}: {' '.join(x.bottom)} > {' '.join(x.top)}" for x in layers]


@pytest.mark.parametrize(
    ("layers", "expected"),
    [
        (
            [layer("a", "", "x"), layer("b", "x", "y"), layer("c", "y")],
            ["a:  > x", "b: x > y", "c: y > "],
        ),
        (
            [layer("a", "", "x"), layer("b", "x", "y"), layer("c", "x", "z")],
            [
                "a:  > x",
                "x_a_0_split: x > x_a_0_split_0 x_a_0_split_1",
                "b: x_a_0_split_0 > y",
                "c: x_a_0_split_1 > z",
            ],
        ),
        (
            [layer("a", "", "x"), layer("b", "x x", "y")],
            [
                "a:  > x",
                "x_a_0_split: x > x_a_0_split_0 x_a_0_split_1",
                "b: x_a_0_split_0 x_a_0_split_1 > y",
            ],
        ),
        (
            [layer("a", "", "x"), layer("r", "x", "x"), layer("b", "x", "y"), layer("c", "x", "z")],
            [
                "a:  > x",
                "r: x > x",
                "x_r_0_split: x > x_r_0_split_0 x_r_0_split_1",
                "b: x_r_0_split_0 > y",
                "c: x_r_0_split_1 > z",
            ],
        ),
        (
            [layer("a", "", "x y"), layer("b", "x y", "p"), layer("c", "y", "q")],
            [
                "a:  > x y",
                "y_a_1_split: y > y_a_1_split_0 y_a_1_split_1",
                "b: x y_a_1_split_0 > p",
                "c: y_a_1_split_1 > q",
            ],
        ),
    ],
    ids=[
        "a chain",
        "two readers",
        "one layer reads twice",
        "after a layer in place",
        "the second top",
    ],
)
def test_each_reader_gets_a_copy(layers: list[LayerParameter], expected: list[str]) -> None:
    """A Split has Caffe's name and follows the last layer that writes the blob
    before its readers.
    """
    assert shown(insert_splits(layers)) == expected


def test_a_loss_weight_is_one_more_reader() -> None:
    """The loss weight moves from the layer to the first copy."""
    layers = insert_splits([layer("a", "", "x", (2.0,)), layer("b", "x", "y")])
    assert [x.loss_weight for x in layers] == [(0.0,), (2.0, 0.0), ()]
    assert shown(layers)[2] == "b: x_a_0_split_1 > y"


def test_a_loss_weight_without_readers_stays() -> None:
    layers = [layer("a", "", "x", (2.0,))]
    assert insert_splits(layers) == layers
