"""The layers of a net, and errors in its text."""

from __future__ import annotations

import pytest

import netlib
from netlib.proto import prototxt, schema
from netlib.proto.messages import NetState, NetStateRule
from netlib.proto.net_parameter import meets
from tests.netlib.conftest import MakeNet
from tests.support.nets import X


def names(net: netlib.Net) -> list[str]:
    return [layer.name for layer in net.layers if layer.type != "Split"]


@pytest.mark.parametrize(
    ("rule", "state", "expected"),
    [
        ("", "phase: TRAIN", True),
        ("phase: TEST", "phase: TRAIN", False),
        ("min_level: 2", "level: 1", False),
        ("min_level: 2 max_level: 3", "level: 3", True),
        ("max_level: 3", "level: 4", False),
        ('stage: "a" stage: "b"', 'stage: "a"', False),
        ('stage: "a" stage: "b"', 'stage: "b" stage: "a"', True),
        ('not_stage: "a"', 'stage: "a" stage: "b"', False),
        ('phase: TRAIN stage: "a"', 'phase: TRAIN stage: "a"', True),
    ],
)
def test_a_rule_is_met_when_all_its_conditions_are(rule: str, state: str, expected: bool) -> None:
    found = meets(
        schema.read(prototxt.parse(state), NetState),
        schema.read(prototxt.parse(rule), NetStateRule),
    )
    assert found == expected


RULES = X + "".join(
    f'layer {{ name: "{name}" type: "Power" bottom: "x" top: "{name}" {rules} }} '
    for name, rules in {
        "train": "include { phase: TRAIN }",
        "test": "include { phase: TEST }",
        "deep": "include { min_level: 1 }",
        "not_a": 'exclude { stage: "a" }',
        "a_or_test": 'include { stage: "a" } include { phase: TEST }',
        "never_both": 'exclude { phase: TRAIN } exclude { stage: "a" }',
    }.items()
)


@pytest.mark.parametrize(
    ("phase", "options", "expected"),
    [
        (netlib.TRAIN, {}, ["x", "train", "not_a"]),
        (netlib.TEST, {}, ["x", "test", "not_a", "a_or_test", "never_both"]),
        (netlib.TRAIN, {"level": 1, "stages": ["a"]}, ["x", "train", "deep", "a_or_test"]),
        (netlib.TEST, {"stages": ["a"]}, ["x", "test", "a_or_test"]),
    ],
)
def test_include_and_exclude(
    net_of: MakeNet, phase: int, options: dict, expected: list[str]
) -> None:
    """One matching include rule suffices; one matching exclude rule excludes."""
    assert names(net_of(RULES, phase, **options)) == expected


def test_the_state_may_stand_in_the_net(net_of: MakeNet) -> None:
    """``state { }`` in the net sets phase, level and stages that the caller does not give."""
    net = netlib.Net(prototxt.parse('state { phase: TRAIN level: 1 stage: "a" } ' + RULES))
    assert net.phase == netlib.TRAIN
    assert names(net) == ["x", "train", "deep", "a_or_test"]


@pytest.mark.parametrize(
    ("text", "shapes"),
    [
        ('input: "a" input_dim: 2 input_dim: 3 input_dim: 4 input_dim: 5', {"a": (2, 3, 4, 5)}),
        ('input: "a" input_shape { dim: 2 dim: 3 }', {"a": (2, 3)}),
        (
            'input: "a" input: "b" input_shape { dim: 2 } input_shape { dim: 3 }',
            {"a": (2,), "b": (3,)},
        ),
        (
            'input: "a" input: "b" ' + "input_dim: 1 " * 4 + "input_dim: 2 " * 4,
            {"a": (1,) * 4, "b": (2,) * 4},
        ),
        (
            'layer { name: "a" type: "Input" top: "a" top: "b" input_param { shape { dim: 2 } } }',
            {"a": (2,), "b": (2,)},
        ),
    ],
)
def test_inputs_old_and_new(net_of: MakeNet, text: str, shapes: dict[str, tuple[int, ...]]) -> None:
    """``input_dim`` has four values per input; ``input_shape`` and an Input layer have one shape
    per input or top.
    """
    net = net_of(text)
    assert net.inputs == list(shapes)
    assert {name: blob.shape for name, blob in net.blobs.items()} == shapes
    again = netlib.Net(net.param)
    assert {name: blob.shape for name, blob in again.blobs.items()} == shapes


def test_an_input_without_a_shape_that_a_layer_has_too(net_of: MakeNet) -> None:
    """The line ``input`` of an older file is dropped if the net has an Input layer for this
    blob, as in Caffe.
    """
    net = net_of('input: "x" ' + X + 'layer { name: "p" type: "Power" bottom: "x" top: "p" }')
    assert net.inputs == ["x"]
    assert net.blobs["x"].shape == (2, 3)
