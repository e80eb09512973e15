"""From a tree to typed messages: values, defaults, merging and error messages."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import pytest

import netlib
from netlib.proto import prototxt, schema
from netlib.proto.messages import LayerParameter, NetParameter, SolverParameter
from netlib.proto.prototxt import Message
from netlib.proto.schema import Double, Int64, UInt
from tests.support.bad_input import bad_inputs, in_table
from tests.support.tables import lines_of


@dataclass(frozen=True)
class Inner:
    """A nested message."""

    x: int = 1
    names: tuple[str, ...] = ()


@dataclass(frozen=True)
class Outer:
    """One field of every kind."""

    needed: int
    text: str = "default"
    flag: bool = False
    count: UInt = 0
    whole: int = 0
    long: Int64 = 0
    ratio: float = 0.1
    exact: Double = 0.1
    pool: Literal["MAX", "AVE"] = "MAX"
    maybe: float | None = None
    many: tuple[UInt, ...] = ()
    inner: Inner = Inner()
    inners: tuple[Inner, ...] = ()
    tree: Message | None = None


def read(text: str) -> Outer:
    """Read ``text`` with the required field ``needed`` added."""
    return schema.read(prototxt.parse("needed: 1 " + text, "f"), Outer)


@pytest.mark.parametrize(
    ("text", "field", "value"), lines_of(Path(__file__).with_name("values.txt"))
)
def test_values(text: str, field: str, value: str) -> None:
    """Values are read as in protobuf; floats have 32 bits, and a message written in
    parts is merged.
    """
    assert repr(getattr(read(text), field)) == value


@bad_inputs(netlib.PrototxtError, in_table(Path(__file__).with_name("schema_mistakes.txt"), "f:"))
def test_mistakes(given: str, rejected: Any) -> None:
    with rejected:
        read(given)


def test_a_missing_required_field() -> None:
    with pytest.raises(
        netlib.PrototxtError, match=r"^f:1:1: error: missing required field 'needed' in Outer$"
    ):
        schema.read(prototxt.parse("", "f"), Outer)


def test_the_options_of_a_layer_stay_trees() -> None:
    """Every ``*_param`` block is kept as a tree, merged if it occurs twice; the layer
    reads it later.
    """
    text = "layer { x_param { a: 1 } x_param { b: 2 } y_param { } }"
    [layer] = schema.read(prototxt.parse(text, "f"), NetParameter).layer
    assert {name: [f.name for f in block.fields] for name, block in layer.blocks.items()} == {
        "x_param": ["a", "b"],
        "y_param": [],
    }


def test_places_of_fields() -> None:
    """The position is that of the field, or that of the message if the field is not given."""
    layer = schema.read(prototxt.parse('\n name: "a" bottom: "x" bottom: "y"', "f"), LayerParameter)
    assert str(schema.position_of(layer, "name")) == "f:2:2"
    assert str(schema.position_of(layer, "bottom", 1)) == "f:2:24"
    assert str(schema.position_of(layer, "top")) == "f:1:1"
    assert schema.position_of(LayerParameter()).source == "<built in code>"


def test_the_defaults_of_a_solver_are_caffes() -> None:
    solver = schema.read(prototxt.parse(""), SolverParameter)
    assert (solver.type, solver.iter_size, solver.average_loss, solver.regularization_type) == (
        "SGD",
        1,
        1,
        "L2",
    )
    assert (solver.clip_gradients, solver.snapshot_after_train, solver.test_initialization) == (
        -1,
        True,
        True,
    )
    assert (solver.momentum, solver.random_seed) == (0, -1)
    assert [round(x, 9) for x in (solver.momentum2, solver.rms_decay, solver.delta)] == [
        0.999000013,
        0.99000001,
        1e-8,
    ]
