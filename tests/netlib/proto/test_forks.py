"""Options of forks of Caffe: accepted without effect, or named in the error; binary
files keep them.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import netlib
from netlib.net import Net
from netlib.proto import forks, messages, prototxt, schema, wire
from netlib.proto.messages import FORK_NUMBERS, LayerParameter, NetParameter, SolverParameter
from netlib.proto.options import option_blocks
from tests.support.nets import inputs

CLASSES: dict[str, Any] = {
    cls.__name__: cls
    for cls in [
        *option_blocks().values(),
        LayerParameter,
        NetParameter,
        SolverParameter,
        messages.Filler,
    ]
}


@pytest.mark.parametrize("message", list(forks.OPTIONS))
def test_no_option_is_declared_twice(message: str) -> None:
    declared = {schema.written_name(field.name) for field in dataclasses.fields(CLASSES[message])}
    assert not declared & forks.OPTIONS[message].keys()


REQUIRED = {
    "DataParameter": 'source: "d" batch_size: 1',
    "ImageDataParameter": 'source: "l"',
    "InnerProductParameter": "num_output: 1",
}
CHANGES = "of a fork of Caffe changes the result; not supported"
EVERY = [
    (message, name, value)
    for message, options in forks.OPTIONS.items()
    for name, value in options.items()
]


@pytest.mark.parametrize(
    ("message", "name", "harmless"), EVERY, ids=lambda value: str(value).strip('"')
)
def test_every_option_is_ignored_or_refused(message: str, name: str, harmless: str) -> None:
    """A value without effect is ignored; any other is an error, with the same text
    for all options.
    """
    cls, required = CLASSES[message], REQUIRED.get(message, "")
    if harmless != forks.NONE:
        good = "SOME_WORD" if harmless == forks.ANY else harmless
        found, plain = (
            schema.read(prototxt.parse(text + required), cls) for text in (f"{name}: {good} ", "")
        )
        assert found == plain
    if harmless != forks.ANY:
        with pytest.raises(netlib.PrototxtError) as error:
            schema.read(prototxt.parse(f"{name}: 0.375 {required}"), cls)
        expected = f", expected {harmless}" if harmless else ""
        assert str(error.value) == f"<text>:1:1: error: unknown option {name!r} {CHANGES}{expected}"


def test_a_block_of_a_fork_without_effect(net_of: Callable[..., Net]) -> None:
    block = "mn_activation_param { num_nodes: 1 }"
    net_of(inputs(x=(1,)) + f'layer {{ name: "r" type: "ReLU" bottom: "x" top: "y" {block} }}')


def test_weights_of_a_net_with_options_of_forks(
    net_of: Callable[..., Net], tmp_path: Any, rng: np.random.Generator
) -> None:
    nets = [
        net_of(
            inputs(x=(1, 2, 3, 3))
            + f'layer {{ name: "c" type: "Convolution" bottom: "x" top: "y" {of_layer} '
            f"convolution_param {{ num_output: 2 kernel_size: 1 {of_block} }} }}"
        )
        for of_layer, of_block in (("", ""), ('engine: "MKLDNN"', "engine: MKLDNN relu: false"))
    ]
    nets[0].params["c"][0].data[...] = nets[1].params["c"][0].data
    x = rng.normal(size=(1, 2, 3, 3))
    assert np.array_equal(*(net.forward(x=x)["y"] for net in nets))
    for i, net in enumerate(nets):
        net.save(str(tmp_path / f"{i}.caffemodel"))
    wanted, found = (
        wire.decode((tmp_path / f"{i}.caffemodel").read_bytes(), NetParameter) for i in range(2)
    )
    assert str(found) == str(wanted).replace("kernel_size: 1\n", "kernel_size: 1\n    engine: 0\n")


CONTENTS = {  # block -> content, as text and encoded
    "interp_param": ("zoom_factor: 8", b"\x18\x08"),
    "recurrent_param": ("num_output: 4", b"\x08\x04"),
    "psroi_pooling_param": ("group_size: 7", b"\x18\x07"),
    "roi_pooling_param": ("pooled_h: 7", b"\x08\x07"),
    "relu6_param": ("negative_slope: 0.5", b"\x0d\x00\x00\x00\x3f"),
    "shuffle_channel_param": ("group: 3", b"\x08\x03"),
    "smooth_l1_loss_param": ("sigma: 0.5", b"\x0d\x00\x00\x00\x3f"),
    "upsample_param": ("upsample_h: 45", b"\x30\x2d"),
}


def varint(number: int) -> bytes:
    if number < 128:
        return bytes([number])
    return bytes([number & 127 | 128]) + varint(number >> 7)


def layer_bytes(type_: str, number: int, content: bytes) -> bytes:
    name_and_type = b"\x0a\x01a\x12" + varint(len(type_)) + type_.encode()
    return name_and_type + varint(number << 3 | 2) + varint(len(content)) + content


@pytest.mark.parametrize(
    ("type_", "number"),
    [
        (type_, n)
        for type_, (block, numbers) in FORK_NUMBERS.items()
        for n in (*numbers, messages.BLOCKS[block])
    ],
)
def test_each_fork_has_its_own_number(type_: str, number: int) -> None:
    """The block of a layer is read under the number of each fork, and written back under it."""
    block = FORK_NUMBERS[type_][0]
    text, content = CONTENTS[block]
    data = layer_bytes(type_, number, content)
    tree = wire.decode(data, LayerParameter)
    assert str(tree) == f'name: "a"\ntype: "{type_}"\n{block} {{\n  {text}\n}}\n'
    assert wire.encode(tree, LayerParameter) == data
    parsed = wire.encode(prototxt.parse(str(tree)), LayerParameter)  # text has no numbers
    assert parsed == layer_bytes(type_, messages.BLOCKS[block], content)
    assert str(wire.decode(parsed, LayerParameter)) == str(tree)


def test_the_type_may_follow_the_options() -> None:
    block = varint(143 << 3 | 2) + b"\x02\x18\x08"
    tree = wire.decode(block + b"\x12\x06Interp", LayerParameter)
    assert str(tree) == 'interp_param {\n  zoom_factor: 8\n}\ntype: "Interp"\n'


def test_a_number_is_that_of_the_type() -> None:
    """Number 143 is ``input_param``, except in the layers of the type that has it in a fork."""
    content = b"\x0a\x02\x0a\x00"  # shape { dim: [] }
    tree = wire.decode(layer_bytes("Input", 143, content), LayerParameter)
    assert "input_param" in str(tree)


@pytest.mark.parametrize("number", [143, 144, 147, 206, 500])
def test_blocks_of_an_unknown_type_are_kept(number: int) -> None:
    """In a layer of an unknown type no number is interpreted; repeated values would be
    merged otherwise.
    """
    data = layer_bytes("SegAccuracy", number, b"\x08\xff\x01\x08\xfe\x01")
    tree = wire.decode(data, LayerParameter)
    assert str(tree) == 'name: "a"\ntype: "SegAccuracy"\n'
    assert wire.encode(tree, LayerParameter) == data


def test_enums_with_values_of_forks_are_kept() -> None:
    """A value of an enum that has no name is an unknown field, as in protobuf."""
    engine = b"\x78\x04"  # engine: MKLDNN
    data = layer_bytes("Convolution", 106, b"\x08\x05" + engine)
    tree = wire.decode(data, LayerParameter)
    assert "num_output: 5" in str(tree)
    assert "engine" not in str(tree)
    assert wire.encode(tree, LayerParameter) == data
    known = wire.decode(layer_bytes("Convolution", 106, b"\x78\x02"), LayerParameter)
    assert "engine: 2" in str(known)
