"""Inserted Split layers: their names, positions and loss weights."""

from __future__ import annotations

import pytest

from netlib.building.splits import insert_splits
from netlib.proto.messages import LayerParameter

pytestmark = pytest.mark.both_engines


def layer(name: str, bottom: str = "", top: str = "", weights: tuple[float, ...] = ()) -> LayerParameter:
    """Return a layer whose blobs are given as names separated by spaces."""
    return LayerParameter(
        name=name, type="T", bottom=tuple(bottom.split()), top=tuple(top.split()), loss_weight=weights
    )


def shown(layers: list[LayerParameter]) -> list[str]:
    """Return ``name: bottoms > tops`` for every layer."""
    return [f"{x.name}: {' '.join(x.bottom)} > {' '.join(x.top)}" for x in layers]


def test_a_chain_needs_no_split() -> None:
    """Blobs with one reader each are not split."""
    layers = [layer("a", "", "x"), layer("b", "x", "y"), layer("c", "y")]
    assert insert_splits(layers) == layers


def test_two_readers_get_a_copy_each() -> None:
    """The Split has Caffe's names and follows the layer that writes the blob."""
    layers = [layer("a", "", "x"), layer("b", "x", "y"), layer("c", "x", "z")]
    assert shown(insert_splits(layers)) == [
        "a:  > x",
        "x_a_0_split: x > x_a_0_split_0 x_a_0_split_1",
        "b: x_a_0_split_0 > y",
        "c: x_a_0_split_1 > z",
    ]


def test_one_layer_that_reads_twice_has_two_copies() -> None:
    """A layer that reads a blob twice, for example x * x, gets two copies."""
    layers = insert_splits([layer("a", "", "x"), layer("b", "x x", "y")])
    assert shown(layers)[2] == "b: x_a_0_split_0 x_a_0_split_1 > y"


def test_readers_after_a_layer_in_place_read_what_it_wrote() -> None:
    """The blob is split after the last layer that writes it before its readers."""
    layers = [layer("a", "", "x"), layer("r", "x", "x"), layer("b", "x", "y"), layer("c", "x", "z")]
    assert shown(insert_splits(layers)) == [
        "a:  > x",
        "r: x > x",
        "x_r_0_split: x > x_r_0_split_0 x_r_0_split_1",
        "b: x_r_0_split_0 > y",
        "c: x_r_0_split_1 > z",
    ]


def test_a_loss_weight_is_one_more_reader() -> None:
    """The loss weight moves from the layer to the first copy."""
    layers = insert_splits([layer("a", "", "x", (2.0,)), layer("b", "x", "y")])
    assert [x.loss_weight for x in layers] == [(0.0,), (2.0, 0.0), ()]
    assert shown(layers)[2] == "b: x_a_0_split_1 > y"


def test_a_loss_weight_without_readers_stays() -> None:
    """A loss that no layer reads is not split."""
    layers = [layer("a", "", "x", (2.0,))]
    assert insert_splits(layers) == layers


def test_the_second_top_of_a_layer() -> None:
    """The number of the top is part of the Split's name."""
    layers = insert_splits([layer("a", "", "x y"), layer("b", "x y", "p"), layer("c", "y", "q")])
    assert shown(layers)[1] == "y_a_1_split: y > y_a_1_split_0 y_a_1_split_1"
