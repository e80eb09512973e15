"""The binary format, on examples worked by hand and against protobuf itself; invalid bytes raise a
one-line error.
"""

from __future__ import annotations

import struct
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from netlib.caffe.proto import caffe_pb2
from netlib.errors import NetlibError, WireError
from netlib.proto import messages, prototxt, schema, upgrade, wire
from netlib.proto.messages import BlobProto, Datum, LayerParameter, SolverParameter, SolverState
from tests.support.bad_input import bad_inputs


def tree_of(data: bytes, cls: Any = LayerParameter) -> str:
    return str(wire.decode(data, cls, "x"))


@pytest.mark.parametrize(
    ("text", "cls", "data"),
    [
        ('name: "ip"', LayerParameter, b"\x0a\x02ip"),  # field 1, the length, the letters
        ("phase: TEST", LayerParameter, b"\x50\x01"),  # field 10, a varint
        ("loss_weight: 0.5", LayerParameter, b"\x2d" + struct.pack("<f", 0.5)),  # field 5, 4 bytes
        # a negative number takes ten bytes
        ("level: -1", messages.NetState, b"\x10" + b"\xff" * 9 + b"\x01"),
        ("dim: 2\ndim: 300", messages.BlobShape, b"\x0a\x03\x02\xac\x02"),  # packed
        ("include {\n  phase: TEST\n}", LayerParameter, b"\x42\x02\x08\x01"),
        (
            "relu_param {\n  negative_slope: 0.5\n}",
            LayerParameter,
            b"\xda\x07\x05\x0d" + struct.pack("<f", 0.5),
        ),
        ("propagate_down: true\npropagate_down: false", LayerParameter, b"\x58\x01\x58\x00"),
        ('data: "\\000\\377"', Datum, b"\x22\x02\x00\xff"),  # bytes that are not text
        ("data: 1.5\ndata: -2.0", BlobProto, b"\x2a\x08" + struct.pack("<2f", 1.5, -2)),
        ("double_data: 0.1", BlobProto, b"\x42\x08" + struct.pack("<d", 0.1)),
    ],
)
def test_text_and_bytes(text: str, cls: Any, data: bytes) -> None:
    assert wire.encode(prototxt.parse(text), cls) == data
    read, parsed = wire.decode(data, cls), prototxt.parse(text)
    assert wire.encode(read, cls) == data
    assert str(schema.to_tree(schema.read(read, cls))) == str(
        schema.to_tree(schema.read(parsed, cls))
    )


def test_numbers_are_read_packed_or_one_by_one() -> None:
    """Also in long or interrupted rows, however the field is declared."""
    numbers = np.arange(1000, dtype="<f4")
    single = b"".join(b"\x2d" + number.tobytes() for number in numbers)
    for data in (
        single,
        b"\x2a" + b"\xa0\x1f" + numbers.tobytes(),
        single[:500] + b"\x08\x01" + single[500:],
    ):
        blob = schema.read(wire.decode(data, BlobProto), BlobProto)
        assert blob.data is not None
        assert blob.data.tolist() == numbers.tolist()
    packed_loss = b"\x2a\x08" + struct.pack("<2f", 1, 2)  # the field is not declared packed
    assert schema.read(wire.decode(packed_loss, LayerParameter), LayerParameter).loss_weight == (
        1,
        2,
    )


def test_an_array_is_a_view_of_the_bytes() -> None:
    data = b"\x2a\x10" + np.arange(4, dtype="<f4").tobytes()
    blob = schema.read(wire.decode(data, BlobProto), BlobProto)
    assert blob.data is not None
    assert blob.data.base is not None
    assert not blob.data.flags.owndata


def test_decoded_bytes_print_as_text_that_parses_back() -> None:
    content = bytes(range(256))
    tree = wire.decode(b"\x22\x80\x02" + content, messages.Datum)
    assert schema.read(tree, messages.Datum).data == content
    assert schema.read(prototxt.parse(str(tree)), messages.Datum).data == content
    assert wire.encode(tree, messages.Datum) == b"\x22\x80\x02" + content


def test_later_values_count_and_parts_of_messages_are_merged() -> None:
    assert tree_of(b"\x0a\x01a\x12\x01t\x0a\x01b") == 'name: "b"\ntype: "t"\n'
    data = b"\xda\x07\x05\x0d" + struct.pack("<f", 0.5) + b"\xda\x07\x02\x10\x01"
    layer = schema.read(wire.decode(data, LayerParameter), LayerParameter)
    assert str(layer.blocks["relu_param"]) == "negative_slope: 0.5\nengine: 1\n"


@bad_inputs(
    WireError,
    {
        f"{data[:20]!r}": (data, f"x: byte {line}")
        for data, line in (
            (b"\x0a", "1: truncated: the message ends within a number"),
            (b"\x0a\x05ab", "0: truncated: field 1 has 5 bytes, but 2 are left"),
            (b"\x42\x02\x08", "0: truncated: field 8 has 2 bytes, but 1 are left"),
            (b"\x42\x01\x08", "3: truncated: the message ends within a number"),
            (b"\x50" + b"\xff" * 11, "1: malformed: a number of more than ten bytes"),
            (b"\x02\x01a", "0: malformed: a field with number 0"),
            (b"\x0e\x00", "0: malformed: wire type 6"),
            (b"\x0c", "0: malformed: wire type 4"),
            (b"\x0b\x10\x01\x0c", "0: malformed: wire type 3"),
            (
                b"\x3a\x07\x2a\x05" + bytes(5),
                "2: malformed: 5 bytes of 'data' are no float32 array",
            ),
        )
    },
)
def test_errors_for_malformed_bytes_have_their_position(given: bytes, rejected: Any) -> None:
    with rejected:
        tree_of(given)


UNKNOWN = {  # field 222
    "a number": b"\xf0\x0d\x96\x01",
    "a number in more bytes than needed": b"\xf0\x0d\x81\x80\x00",
    "4 bytes": b"\xf5\x0dabcd",
    "8 bytes": b"\xf1\x0dabcdefgh",
    "a message": b"\xf2\x0d\x03\x08\x02\x07",
}


@pytest.mark.parametrize("name", list(UNKNOWN))
def test_unknown_fields_are_written_back(name: str) -> None:
    """A field of a fork survives, after the known ones, in the message that had it, read as a
    tree or typed.
    """
    field = UNKNOWN[name]
    known = b"\x0a\x01c\x12\x0bConvolution"
    block = b"\x08\x04"  # num_output: 4
    data = known + b"\xd2\x06" + bytes([len(block + field)]) + block + field + field * 2
    tree = wire.decode(
        known[:3] + field + known[3:] + data[len(known) : -len(field)], LayerParameter
    )
    assert wire.encode(tree, LayerParameter) == data
    typed = schema.changed(schema.read(tree, LayerParameter), propagate_down=())
    assert wire.encode(schema.to_tree(typed), LayerParameter) == data
    assert "convolution_param {\n  num_output: 4\n}" in str(tree)  # text has no unknown fields


@pytest.mark.parametrize(
    "data", [b"\x08\x05", b"\x55abcd"], ids=["a string as a number", "an enum as 4 bytes"]
)
def test_a_field_of_another_wire_type_is_unknown(data: bytes) -> None:
    """A known number with a wire type that its field cannot have is an unknown field,
    as in protobuf.
    """
    tree = wire.decode(data, LayerParameter)
    assert str(tree) == ""
    assert wire.encode(tree, LayerParameter) == data


@pytest.mark.parametrize(
    "rest", [b"\xff" * 4 + b"\x0f", b"\xff" * 9 + b"\x01"], ids=["32 bits", "64 bits"]
)
def test_a_negative_number_of_32_or_64_bits(rest: bytes) -> None:
    """Protobuf writes negative numbers with 64 bits, some programs with 32; both are read."""
    assert [
        field.value.text for field in wire.decode(b"\x28" + rest, messages.Datum, "x").fields
    ] == ["-1"]


def test_the_number_of_fields_is_bounded(monkeypatch: pytest.MonkeyPatch) -> None:
    """The number of fields and of packed values is limited, because a small file could
    take much memory.
    """
    monkeypatch.setattr(wire, "MAX_FIELDS", 100)
    with pytest.raises(WireError, match="x: byte 200: more than 100 fields and numbers; "):
        tree_of(b"\x1a\x00" * 101)
    with pytest.raises(WireError, match="x: byte 0: more than 100 fields and numbers"):
        tree_of(b"\x0a\x65" + b"\x01" * 101, messages.BlobShape)


@given(st.binary(max_size=60))
def test_any_bytes_are_a_message_or_one_line(data: bytes) -> None:
    for cls in (LayerParameter, SolverState, BlobProto, upgrade.AnyNetParameter):
        try:
            schema.read(wire.decode(data, cls, "x"), cls)
        except NetlibError as error:
            assert "\n" not in str(error)


TEXT = """
    name: "c" type: "Convolution" bottom: "x" top: "y" phase: TEST loss_weight: 0.1 loss_weight: 2
    param { name: "w" lr_mult: 3e-7 } propagate_down: true include { stage: "a" stage: "ü" min_level: -5 }
    convolution_param { num_output: 7 kernel_size: 3 kernel_size: 5 weight_filler { type: "xavier" sparse: -1 } }
    blobs { shape { dim: 2 dim: 3 } data: 1 data: 2 data: 3 data: 4 data: 5 data: 0.333 } blobs { num: 1 width: 2 }
"""


def test_protobuf_reads_what_we_write() -> None:
    message = caffe_pb2.LayerParameter()
    data = wire.encode(prototxt.parse(TEXT), LayerParameter)
    message.ParseFromString(data)
    assert message.convolution_param.kernel_size == [3, 5]
    assert message.include[0].min_level == -5
    assert message.blobs[0].data[5] == np.float32(0.333)
    assert message.SerializeToString() == data


@pytest.mark.parametrize("name", list(UNKNOWN))
def test_protobuf_writes_unknown_fields_as_we_do(name: str) -> None:
    layer = b"\x12\x04ReLU" + UNKNOWN[name] + b"\xda\x07\x05\x0d" + bytes(4)
    message = caffe_pb2.LayerParameter.FromString(layer)
    tree = wire.decode(layer, LayerParameter)
    assert wire.encode(tree, LayerParameter) == message.SerializeToString() != layer
    message.name = "r"
    tree.fields.append(prototxt.parse('name: "r"').fields[0])
    assert wire.encode(tree, LayerParameter) == message.SerializeToString()


@given(
    st.builds(
        SolverParameter,
        net=st.text(max_size=5),
        base_lr=st.floats(width=32, allow_nan=False),
        max_iter=st.integers(0, 2**31 - 1),
        random_seed=st.integers(-(2**63), 2**63 - 1),
        test_interval=st.integers(0, 300),
        stepvalue=st.lists(st.integers(0, 2**31 - 1), max_size=3).map(tuple),
        debug_info=st.booleans(),
        snapshot_format=st.sampled_from(["HDF5", "BINARYPROTO"]),
        weights=st.lists(st.text(max_size=3)).map(tuple),
    )
)
def test_protobuf_and_we_agree_on_any_message(solver: SolverParameter) -> None:
    data = wire.encode(schema.to_tree(solver), SolverParameter)
    message = caffe_pb2.SolverParameter()
    message.ParseFromString(data)
    assert message.SerializeToString() == data
    again = schema.read(wire.decode(data, SolverParameter), SolverParameter)
    # its defaults have 32 bits
    assert again == schema.read(schema.to_tree(solver), SolverParameter)
