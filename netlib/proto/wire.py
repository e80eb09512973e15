"""Decoder and encoder of protocol buffers' binary format: Caffe's .caffemodel, .solverstate
and .binaryproto.

A message is a sequence of fields. A field is a key, its number * 8 + its wire type, and a value:

    0   a varint: seven bits per byte, lowest first; the high bit marks that another byte follows
    1   8 bytes                                      5   4 bytes
    2   a length (varint) and that many bytes: a string, a nested message, or many numbers in one
        block ("packed")
    3,4 start and end of a group, which Caffe does not use; they are rejected

Names are not in the file; the dataclasses that also read prototxt (schema.py) define number and
type of each field. Unknown fields, and enums with unknown values, are kept as they are and written
back after the known fields, as in protobuf. Forks of Caffe use the same numbers for different
options of layers, so in a layer the type decides: the block of its type is found under each fork's
number (FORK_NUMBERS), and all blocks of an unknown type are unknown fields. Reference: "Encoding"
of Protocol Buffers.

Input is not trusted: lengths are checked against the enclosing message, arrays are views of the
file's bytes, and the number of fields is limited, so memory use is bounded by the size of the file
and MAX_FIELDS.
"""

from __future__ import annotations

import dataclasses
import functools
import struct
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from netlib.errors import WireError
from netlib.proto import forks, schema
from netlib.proto.messages import BLOCKS, FORK_NUMBERS, LayerParameter
from netlib.proto.options import layer_types, option_blocks
from netlib.proto.prototxt import Bytes, Field, Message, Numbers, Place, Scalar, Unknown
from netlib.proto.schema import ARRAYS, Double
from netlib.proto.upgrade import AnyNetParameter

VARINT, EIGHT_BYTES, LENGTH, FOUR_BYTES = 0, 1, 2, 5
MAX_FIELDS = 100_000  # per file; the largest nets have about ten thousand
Piece = bytes | memoryview  # a memoryview avoids a copy of large arrays


@dataclass(frozen=True)
class Offset(Place):
    """A place in a binary file."""

    byte: int

    def __str__(self) -> str:
        return f"{self.source}: byte {self.byte}"


@dataclass(frozen=True)
class WireField:
    """Number, name and type of a field of a message.

    stated      kind of one value; None for an options block of a layer, whose dataclass is
                imported when it is needed
    is_of_fork  whether the number is that of a fork, not the declared one
    """

    number: int
    name: str
    stated: Any
    repeated: bool = False
    packed: bool = False
    default: Any = None
    is_of_fork: bool = False

    @functools.cached_property
    def kind(self) -> Any:
        """The kind of one value (schema.kind_of); the dataclass of a nested message."""
        return option_blocks()[self.name] if self.stated is None else self.stated

    @functools.cached_property
    def wire_type(self) -> int:
        """Wire type of one value."""
        if self.stated is None or self.kind in (str, bytes) or schema.is_message(self.kind):
            return LENGTH
        if self.kind in ARRAYS:
            return FOUR_BYTES if ARRAYS[self.kind].itemsize == 4 else EIGHT_BYTES
        return FOUR_BYTES if self.kind is float else EIGHT_BYTES if self.kind is Double else VARINT

    def accepts(self, wire_type: int) -> bool:
        """Whether values can be encoded with this wire type: numbers of a repeated field
        also as one block.
        """
        return wire_type == self.wire_type or (wire_type == LENGTH and self.repeated)


@functools.cache
def fields_of(cls: type) -> dict[str, WireField]:
    """The fields of a message by name; for a layer, including the options of all layer types."""
    known: dict[str, WireField] = {}
    for name, info in schema.fields_of(cls).items():
        # the only messages kept as trees are nets
        kind = AnyNetParameter if info.kind is Message else info.kind
        known[name] = WireField(info.number, name, kind, info.repeated, info.packed, info.default)
    for field in dataclasses.fields(cls):
        for block, number in field.metadata.get("numbers", {}).items():
            known[block] = WireField(number, block, None)
    return known


# ------------------------------------------------------------------------------------------ reading


def decode(data: bytes, cls: type, source: str = "<bytes>", strict: bool = False) -> Message:
    """Decode a message of type ``cls`` to a tree. Raises WireError if the bytes are not valid.

    ``strict`` rejects unknown fields instead of keeping them.
    """
    return _Decoder(data, source, strict).message(cls, 0, len(data))


class _Decoder:
    """Decoder of one file.

    ``at`` is the offset of a field, ``start`` and ``stop`` are those of its value.

    ``end`` is the end of the message. Every method raises WireError if the bytes are invalid.
    """

    def __init__(self, data: bytes, source: str, strict: bool) -> None:
        self.data, self.source, self.strict = data, source, strict
        self.count = 0

    def fail(self, at: int, message: str) -> WireError:
        return WireError(f"{Offset(self.source, at)}: {message}")

    def one_more(self, at: int) -> None:
        """Count a field, or a number in a packed field: each takes more memory than
        bytes in the file.
        """
        self.count += 1
        if self.count > MAX_FIELDS:
            raise self.fail(
                at, f"more than {MAX_FIELDS} fields and numbers; expected a file in Caffe's format"
            )

    def message(self, cls: type, begin: int, end: int) -> Message:
        """Decode the fields of ``cls`` between two offsets."""
        layer_type = self.type_of(begin, end) if cls is LayerParameter else ""
        known = _by_number(cls, layer_type)
        fields: list[Field] = []
        # index of each field that is not repeated: later values replace it
        single: dict[str, int] = {}
        at = begin
        while at < end:
            self.one_more(at)
            place = Offset(self.source, at)
            key, start = self.varint(at, end)
            number, wire_type = key >> 3, key & 7
            stop = self.end_of(wire_type, number, start, end, at)
            spec = known.get(number)
            if (
                spec is None
                or not spec.accepts(wire_type)
                or self.is_unknown_value(spec, wire_type, start)
            ):
                if self.strict:
                    raise self.fail(at, f"field {number} of wire type {wire_type} is unknown here")
                fields.append(Field("", Unknown(bytes(self.data[at:stop])), place))
            elif spec.kind in ARRAYS and wire_type != LENGTH:
                stop, array = self.row(ARRAYS[spec.kind], at, start, end)
                fields.append(Field(spec.name, Numbers(array, place), place))
            else:
                for value in self.values(spec, wire_type, place, start, stop):
                    index = len(fields)
                    if not spec.repeated and not schema.is_message(spec.kind):
                        index = single.setdefault(spec.name, index)
                    field = Field(spec.name, value, place, number if spec.is_of_fork else None)
                    fields[index : index + 1] = [field]
            at = stop
        return Message(fields, Offset(self.source, begin))

    def type_of(self, begin: int, end: int) -> str:
        """The type of the layer between two offsets; empty if it has none."""
        at = begin
        found = b""
        while at < end:
            key, start = self.varint(at, end)
            stop = self.end_of(key & 7, key >> 3, start, end, at)
            if key == 2 << 3 | LENGTH:
                found = bytes(self.data[self.varint(start, stop)[1] : stop])
            at = stop
        return found.decode("utf-8", "surrogateescape")

    def is_unknown_value(self, spec: WireField, wire_type: int, start: int) -> bool:
        """Whether a field is an enum with a number that has no name."""
        names = schema.enum_of(spec.kind) if wire_type == VARINT else {}
        return bool(names) and self.varint(start, len(self.data))[0] not in names.values()

    def varint(self, at: int, end: int) -> tuple[int, int]:
        """Decode a varint; returns the number and the offset after it."""
        value = 0
        for place in range(10):
            if at + place >= end:
                raise self.fail(at, "truncated: the message ends within a number")
            byte = self.data[at + place]
            value |= (byte & 127) << 7 * place
            if byte < 128:
                return value & 0xFFFFFFFFFFFFFFFF, at + place + 1
        raise self.fail(at, "malformed: a number of more than ten bytes")

    def end_of(self, wire_type: int, number: int, start: int, end: int, at: int) -> int:
        """Offset of the end of the value that starts at ``start``."""
        if number == 0:
            raise self.fail(at, "malformed: a field with number 0")
        if wire_type == VARINT:
            return self.varint(start, end)[1]
        if wire_type == LENGTH:
            size, start = self.varint(start, end)
        elif wire_type in (EIGHT_BYTES, FOUR_BYTES):
            size = 8 if wire_type == EIGHT_BYTES else 4
        else:
            raise self.fail(at, f"malformed: wire type {wire_type}")
        if start + size > end:
            raise self.fail(
                at, f"truncated: field {number} has {size} bytes, but {end - start} are left"
            )
        return start + size

    def row(self, dtype: np.dtype[Any], at: int, start: int, end: int) -> tuple[int, NDArray[Any]]:
        """Decode consecutive numbers that each have the same key; returns the end
        offset and an array.

        Some old files have millions of them. The bytes are viewed as rows of key and number, in
        blocks that double in size.
        """
        key = self.data[at:start]
        width = start - at + dtype.itemsize
        block = 64
        while True:
            rows = np.frombuffer(
                self.data, np.uint8, min(block, (end - at) // width) * width, at
            ).reshape(-1, width)
            same = (rows[:, : len(key)] == np.frombuffer(key, np.uint8)).all(axis=1)
            count = int(same.argmin()) if not same.all() else len(same)
            if count < block:
                break
            block *= 2
        return at + count * width, np.ascontiguousarray(rows[:count, len(key) :]).view(
            dtype
        ).ravel()

    def values(
        self, spec: WireField, wire_type: int, place: Offset, start: int, stop: int
    ) -> Iterator[Scalar | Numbers | Message]:
        """Yield the value of the field, or all numbers of a packed field."""
        if wire_type != LENGTH:
            yield self.number(spec, start, stop)
            return
        start = self.varint(start, stop)[1]
        if spec.kind in ARRAYS:
            dtype = ARRAYS[spec.kind]
            if (stop - start) % dtype.itemsize:
                raise self.fail(
                    place.byte,
                    f"malformed: {stop - start} bytes of {spec.name!r} are no {dtype.name} array",
                )
            count = (stop - start) // dtype.itemsize
            yield Numbers(np.frombuffer(self.data, dtype, count, start), place)
        elif schema.is_message(spec.kind):
            yield self.message(spec.kind, start, stop)
        elif spec.wire_type == LENGTH:
            content = Bytes(bytes(self.data[start:stop]), place)
            yield content if spec.kind is bytes else Scalar("string", content.text, place)
        else:
            while start < stop:
                self.one_more(place.byte)
                begin = start
                start = self.end_of(spec.wire_type, spec.number, begin, stop, begin)
                yield self.number(spec, begin, start)

    def number(self, spec: WireField, start: int, stop: int) -> Scalar:
        """Decode one number."""
        place = Offset(self.source, start)
        if spec.wire_type == VARINT:
            value = self.varint(start, stop)[0]
            if spec.kind is bool:
                return Scalar("word", "true" if value else "false", place)
            value -= 2**64 if value >= 2**63 else 0
            # some encoders write negative numbers in 32 bits
            if spec.kind is int and 2**31 <= value < 2**32:
                value -= 2**32
            if value not in schema.INTEGERS.get(spec.kind, (value,)):
                raise self.fail(
                    start, f"{spec.name!r} expects {schema.expected(spec.kind)}, found {value}"
                )
            return Scalar("number", str(value), place)
        [number] = np.frombuffer(
            self.data, "<f4" if spec.wire_type == FOUR_BYTES else "<f8", 1, start
        )
        return Scalar("number" if np.isfinite(number) else "word", str(number), place)


@functools.lru_cache(256)
def _by_number(cls: type, layer_type: str) -> dict[int, WireField]:
    """The fields of a message. Of a layer: without blocks if its type is unknown, and that of its
    type also under the numbers of forks.
    """
    known = {info.number: info for info in fields_of(cls).values()}
    if layer_type not in ("", "Python") and layer_type not in layer_types():
        return {number: info for number, info in known.items() if info.name not in BLOCKS}
    name, numbers = FORK_NUMBERS.get(layer_type, ("", ()))
    for number in numbers:
        info = fields_of(LayerParameter)[name]
        known[number] = dataclasses.replace(info, number=number, is_of_fork=True)
    return known


# ------------------------------------------------------------------------------------------ writing


def encode(message: Message, cls: type) -> bytes:
    """Encode a tree as a message of type ``cls``, with fields in the order of their numbers,
    unknown ones last.

    Raises PrototxtError if ``cls`` does not define a field or defines it with another type.
    """
    return b"".join(_parts(message, cls))


def _parts(message: Message, cls: type) -> list[Piece]:
    known = fields_of(cls)
    found: dict[str, list[Field]] = {}
    for field in message.fields:
        if isinstance(field.value, Unknown):
            continue
        if field.name not in known:
            if forks.has_no_effect(cls.__name__, field):
                continue
            raise schema.unknown_field(field, known, cls.__name__)
        found.setdefault(field.name, []).append(field)
    parts: list[Piece] = []
    for name in sorted(found, key=lambda name: found[name][0].number or known[name].number):
        spec = known[name]
        if spec.kind in ARRAYS:
            array = schema.array_of(found[name], spec.kind)
            if spec.packed:
                whole = memoryview(np.ascontiguousarray(array)).cast("B") if array.size else b""  # type: ignore[arg-type]
                parts += _with_length(spec.number, [whole])
            else:
                parts += [_key(spec.number, spec.wire_type) + number.tobytes() for number in array]
        elif spec.packed:
            parts += _with_length(spec.number, [_one(spec, field) for field in found[name]])
        else:
            for field in found[name]:
                parts += _with_key(spec, field)
    return parts + [
        item.value.encoded for item in message.fields if isinstance(item.value, Unknown)
    ]


def _with_key(spec: WireField, field: Field) -> list[Piece]:
    """Encode one value of a field that is not packed."""
    if schema.is_message(spec.kind):
        return _with_length(
            field.number or spec.number, _parts(schema.message_of(field), spec.kind)
        )
    if spec.wire_type == LENGTH:
        return _with_length(spec.number, [_one(spec, field)])
    return [_key(spec.number, spec.wire_type) + _one(spec, field)]


def _with_length(number: int, parts: list[Piece]) -> list[Piece]:
    """Prepend key and length."""
    return [_key(number, LENGTH) + _varint(sum(map(len, parts))), *parts]


def _key(number: int, wire_type: int) -> bytes:
    return _varint(number << 3 | wire_type)


def _one(spec: WireField, field: Field) -> bytes:
    """Encode one value without its key."""
    value = schema.value_of(field, spec.kind)
    if spec.kind is str:
        return value.encode("utf-8", "surrogateescape")
    if spec.kind is bytes:
        return value
    if names := schema.enum_of(spec.kind):
        value = names[value]
    if spec.wire_type == VARINT:
        return _varint(int(value) % 2**64)
    return struct.pack("<f" if spec.wire_type == FOUR_BYTES else "<d", value)


def _varint(value: int) -> bytes:
    out = bytearray()
    while value > 127:
        out.append(value & 127 | 128)
        value >>= 7
    out.append(value)
    return bytes(out)
