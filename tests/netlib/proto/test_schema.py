"""From a tree to typed messages: values, defaults, merging and error messages."""

from __future__ import annotations

import math
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
    ("text", "field", "expected"),
    [
        ("", "text", "default"),
        ('text: "x"', "text", "x"),
        ("flag: true", "flag", True),
        ("flag: t", "flag", True),
        ("flag: True", "flag", True),
        ("flag: false", "flag", False),
        ("flag: 0", "flag", False),
        ("flag: 01", "flag", True),
        ("flag: 0x0", "flag", False),
        ("count: 0x10", "count", 16),
        ("count: 010", "count", 8),
        ("count: 4294967295", "count", 2**32 - 1),
        ("whole: -2147483648", "whole", -(2**31)),
        ("whole: 0x7fffffff", "whole", 2**31 - 1),
        ("long: -9223372036854775808", "long", -(2**63)),
        ("long: 9223372036854775807", "long", 2**63 - 1),
        ("", "ratio", 0.10000000149011612),  # a default has 32 bits, too
        ("", "exact", 0.1),
        ("ratio: 1.f", "ratio", 1.0),
        ("ratio: 2", "ratio", 2.0),
        ("ratio: -1e-2", "ratio", -0.009999999776482582),
        ("exact: -1e-2", "exact", -0.01),
        ("ratio: inf", "ratio", math.inf),
        ("ratio: 1e60", "ratio", math.inf),
        ("pool: AVE", "pool", "AVE"),
        ("pool: 1", "pool", "AVE"),
        ("maybe: 2", "maybe", 2.0),
        ("", "maybe", None),
        ("many: 1 many: [2, 3]", "many", (1, 2, 3)),
        ("inner { x: 5 }", "inner", Inner(5)),
        ('inner { x: 5 names: "a" } inner { names: "b" }', "inner", Inner(5, ("a", "b"))),
        ("inners { x: 5 } inners { }", "inners", (Inner(5), Inner())),
    ],
)
def test_values(text: str, field: str, expected: Any) -> None:
    """Values are read as in protobuf; floats have 32 bits, and a message written in
    parts is merged.
    """
    assert getattr(read(text), field) == expected


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
