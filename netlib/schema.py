"""Tree → typed messages: what a message may say is written once, for text and for binary files.

A message is a frozen dataclass; each field is one line with its type, its number in binary files, its default (none:
required) and its meaning. ``read`` fills one from a tree and points at the place of every mistake.

    str, int, bool          as they are          UInt              an int that is not negative
    float                   rounded to 32 bits, as protobuf's are    Double   not rounded
    Literal["MAX", "AVE"]   an enum, by name or by number, counted from 0
    OneBased[Literal[...]]  an enum whose numbers begin at 1
    tuple[X, ...]           a repeated field     X | None          an optional field
    a dataclass             a nested message     Message           a nested message, left as a tree

A field ``from_`` is ``from`` in the text: the name is a word of Python's.
"""

from __future__ import annotations

import dataclasses
import functools
import math
import struct
import types
import typing
from collections.abc import Sequence
from typing import Annotated, Any, Literal, TypeVar, overload

from netlib.errors import PrototxtError, did_you_mean
from netlib.prototxt import Field, Message, Position, Scalar

T = TypeVar("T")
UInt = Annotated[int, "unsigned"]
Double = Annotated[float, "64 bits"]
Phase = Literal["TRAIN", "TEST"]
Engine = Literal["DEFAULT", "CAFFE", "CUDNN"]  # which implementation Caffe would take; there is one here
OneBased = Annotated[T, "from 1"]


@overload
def numbered(number: int) -> Any: ...
@overload
def numbered(number: int, default: T) -> T: ...
def numbered(number: int, default: Any = dataclasses.MISSING) -> Any:
    """A field of a message, with its number in caffe.proto; without a default it is required."""
    return dataclasses.field(default=default, metadata={"number": number})


def read(message: Message, cls: type[T], what: str | None = None) -> T:
    """Fill the dataclass ``cls`` from a tree. Raises PrototxtError at the field that is wrong."""
    hints, fields = dict(_hints(cls)), {_written(f.name): f for f in dataclasses.fields(cls)}  # type: ignore[arg-type]
    takes_blocks = hints.pop("blocks", None) is not None
    found: dict[str, list[Field]] = {}
    blocks: dict[str, Message] = {}
    for item in message.fields:
        if item.name in hints:
            found.setdefault(item.name, []).append(item)
        elif takes_blocks and item.name.endswith("_param") and isinstance(item.value, Message):
            blocks[item.name] = (
                Message(blocks[item.name].fields + item.value.fields, item.value.position)
                if item.name in blocks
                else item.value
            )
        else:
            raise unknown_field(item, hints)
    values: dict[str, Any] = {name: _field_value(items, hints[name]) for name, items in found.items()}
    for name, spec in fields.items():
        if hints.get(name) is float and name not in values and isinstance(spec.default, float):
            values[name] = _round_to_32_bits(spec.default)
        required = spec.default is dataclasses.MISSING and spec.default_factory is dataclasses.MISSING
        if required and name not in values:
            raise PrototxtError(message.position, f"missing required field {name!r} in {what or cls.__name__}")
    if takes_blocks:
        values["blocks"] = blocks
    result = cls(**{fields[name].name: value for name, value in values.items()})
    object.__setattr__(result, "_tree", message)
    return result


def unknown_field(item: Field, known: typing.Iterable[str]) -> PrototxtError:
    """The error for a field that nobody knows."""
    known = list(known)
    advice = did_you_mean(item.name, known) or f"; known fields: {', '.join(known)}"
    return PrototxtError(item.position, f"unknown field {item.name!r}{advice}")


def changed(message: T, **changes: Any) -> T:
    """The message with some fields changed; it still knows where it stands in its file."""
    return placed(dataclasses.replace(message, **changes), message)  # type: ignore[type-var]


def placed(made: T, origin: object) -> T:
    """``made``, which from now on stands where ``origin`` stands in its file."""
    object.__setattr__(made, "_tree", tree_of(origin))
    return made


def tree_of(message: object) -> Message | None:
    """The tree that a typed message was read from."""
    return getattr(message, "_tree", None)


def gives(message: object, name: str) -> bool:
    """Does the file say this field?"""
    tree = tree_of(message)
    return tree is not None and bool(tree.values(name))


def position_of(message: object, name: str | None = None, index: int = 0) -> Position:
    """Where a typed message, or one field of it, stands in its file."""
    tree = tree_of(message)
    if tree is None:
        return Position("<built in code>", 1, 1)
    places = [f.position for f in tree.fields if f.name == name]
    return places[index] if index < len(places) else tree.position


@functools.cache
def _hints(cls: type) -> dict[str, Any]:
    return {_written(name): hint for name, hint in typing.get_type_hints(cls, include_extras=True).items()}


def _written(name: str) -> str:
    """How the name of a Python field is written in a file."""
    return name.removesuffix("_")


@functools.cache
def enum_of(kind: Any) -> dict[str, int]:
    """The names of an enum with their numbers; of any other kind nothing."""
    first = 0
    if typing.get_origin(kind) is Annotated and "from 1" in typing.get_args(kind):
        kind, first = typing.get_args(kind)[0], 1
    names = typing.get_args(kind) if typing.get_origin(kind) is Literal else ()
    return {str(name): number for number, name in enumerate(names, first)}


def _field_value(items: Sequence[Field], kind: Any) -> Any:
    if typing.get_origin(kind) is tuple:
        return tuple(_value(item, typing.get_args(kind)[0]) for item in items)
    if typing.get_origin(kind) in (types.UnionType, typing.Union):
        kind = next(k for k in typing.get_args(kind) if k is not type(None))
    if len(items) > 1 and not (isinstance(items[0].value, Message) and dataclasses.is_dataclass(kind)):
        raise PrototxtError(items[1].position, f"field {items[1].name!r} is given twice, but is not a repeated field")
    if len(items) > 1:  # protobuf merges a message that is written in parts
        parts = [item.value for item in items if isinstance(item.value, Message)]
        merged = Message([f for part in parts for f in part.fields], parts[0].position)
        return read(merged, typing.cast(type[Any], kind), items[0].name)
    return _value(items[0], kind)


def _value(item: Field, kind: Any) -> Any:
    value, position = item.value, item.position
    if kind is Message or (isinstance(kind, type) and dataclasses.is_dataclass(kind)):
        if not isinstance(value, Message):
            raise PrototxtError(position, f"{item.name!r} is a message: expected {item.name} {{ ... }}, found {value}")
        return value if kind is Message else read(value, kind, item.name)
    if isinstance(value, Message):
        raise PrototxtError(position, f"{item.name!r} is not a message: expected '{item.name}: {_expected(kind)}'")
    result = _scalar(value, kind)
    if result is None:
        where = value.position
        if names := list(enum_of(kind)):
            advice = did_you_mean(value.text, names) or f"; known values: {', '.join(names)}"
            raise PrototxtError(where, f"unknown value {value} of {item.name!r}{advice}")
        raise PrototxtError(where, f"{item.name!r} expects {_expected(kind)}, found {value}")
    return result


def _expected(kind: Any) -> str:
    if names := enum_of(kind):
        return " or ".join(names)
    if kind is UInt:
        return "an integer that is not negative"
    return {
        str: "a string in quotes", int: "an integer", float: "a number", Double: "a number", bool: "true or false",
    }[kind]  # fmt: skip


def _scalar(value: Scalar, kind: Any) -> Any:
    """The Python value of a scalar, or None if it is not of that kind."""
    if kind is str:
        return value.text if value.kind == "string" else None
    if value.kind == "string":
        return None
    if kind is bool:
        return {"true": True, "t": True, "True": True, "1": True,
                "false": False, "f": False, "False": False, "0": False}.get(value.text)  # fmt: skip
    if names := enum_of(kind):
        if value.kind == "word":
            return value.text if value.text in names else None
        number = _integer(value)
        return next((name for name, n in names.items() if n == number), None)
    if kind is Double:
        return _float(value)
    if kind is float:
        double = _float(value)
        return None if double is None else _round_to_32_bits(double)
    number = _integer(value)
    return None if kind is UInt and number is not None and number < 0 else number


def _round_to_32_bits(number: float) -> float:
    try:
        rounded: float = struct.unpack("f", struct.pack("f", number))[0]
    except OverflowError:
        return math.copysign(math.inf, number)
    return rounded


def _integer(value: Scalar) -> int | None:
    text = value.text.lower()
    digits = text.removeprefix("-")
    base = 16 if digits.startswith("0x") else 8 if len(digits) > 1 and digits.startswith("0") else 10
    try:
        number = int(text, base)
    except ValueError:
        return None
    return number if -(2**63) <= number < 2**64 else None


def _float(value: Scalar) -> float | None:
    if value.kind == "word":
        return {"inf": math.inf, "infinity": math.inf, "-inf": -math.inf, "-infinity": -math.inf,
                "nan": math.nan, "-nan": math.nan}.get(value.text.lower())  # fmt: skip
    integer = _integer(value)
    if integer is not None:
        return float(integer)
    try:
        return float(value.text.lower().removesuffix("f"))
    except ValueError:
        return None
