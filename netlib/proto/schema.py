"""Conversion of trees to typed messages, with one declaration per message for text
and binary files.

A message is a frozen dataclass. Each field is one line with its type, its number in binary files,
its default (none if it is required) and its meaning. ``read`` fills one from a tree and reports
every mistake with its position.

    str, bool               as in Python
    int, UInt, Int64        of 32 bits, of 32 bits without sign, of 64 bits
    Natural                 an int that may not be negative
    float                   rounded to 32 bits, as in protobuf       Double   not rounded
    Literal["MAX", "AVE"]   an enum, by name or by number, counted from 0
    OneBased[Literal[...]]  an enum counted from 1
    Annotated[str, ("MAX", "AVE")]  the same as Literal
    Floats, Doubles         a repeated float or double in one array; bytes: a string that
                            need not be text
    tuple[X, ...]           a repeated field     X | None          an optional field
    a dataclass             a nested message     Message           a nested message, left as a tree

A field ``from_`` is written ``from``, which is a keyword in Python.
"""

from __future__ import annotations

import dataclasses
import functools
import inspect
import os
import types
import typing
from collections.abc import Sequence
from typing import Annotated, Any, Literal, TypeVar, overload

import numpy as np
from numpy.typing import NDArray

from netlib.errors import PrototxtError, did_you_mean, meant_or_known
from netlib.proto import forks
from netlib.proto.prototxt import Bytes, Field, Message, Numbers, Place, Position, Scalar, Unknown

T = TypeVar("T")
UInt = Annotated[int, "unsigned"]
Int64 = Annotated[int, "64 bits"]
Natural = Annotated[int, "not negative"]
INTEGERS: dict[Any, range] = {
    int: range(-(2**31), 2**31),
    UInt: range(2**32),
    Int64: range(-(2**63), 2**63),
    Natural: range(2**31),
}
Double = Annotated[float, "64 bits"]
Floats = Annotated[NDArray[np.float32], "<f4"]
Doubles = Annotated[NDArray[np.float64], "<f8"]
ARRAYS: dict[Any, np.dtype[Any]] = {Floats: np.dtype("<f4"), Doubles: np.dtype("<f8")}
Phase = Literal["TRAIN", "TEST"]
# implementation that Caffe selects; ignored, as are those of forks
Engine = Literal["DEFAULT", "CAFFE", "CUDNN"]
OneBased = Annotated[T, "from 1"]


@overload
def numbered(number: int) -> Any: ...
@overload
def numbered(number: int, default: T, packed: bool = False) -> T: ...
def numbered(number: int, default: Any = dataclasses.MISSING, packed: bool = False) -> Any:
    """Declare a field of a message with its number in caffe.proto; without a default
    it is required.

    The numbers of a ``packed`` field are written to binary files as one block.
    """
    return dataclasses.field(default=default, metadata={"number": number, "packed": packed})


@functools.cache
def hints_of(cls: type) -> dict[str, Any]:
    """The attributes of a message with their types."""
    hints: dict[str, Any] = {}
    for base in filter(dataclasses.is_dataclass, reversed(cls.__mro__)):
        own = types.SimpleNamespace(__annotations__=inspect.get_annotations(base))
        # of its module, which need not be in sys.modules (files/own_modules.py)
        names = base.__init__.__globals__
        hints |= typing.get_type_hints(own, names, include_extras=True)
    return hints


@dataclasses.dataclass(frozen=True)
class FieldInfo:
    """A field as its message declares it, with the kind of one value (``kind_of``).

    attribute  its name in Python
    number     0 in messages of text files only
    """

    attribute: str
    number: int
    kind: Any
    repeated: bool
    packed: bool
    default: Any


@functools.cache
def fields_of(cls: type) -> dict[str, FieldInfo]:
    """The fields of a message by their names in files; of a layer, without its blocks."""
    return {
        written_name(field.name): FieldInfo(
            field.name,
            field.metadata.get("number", 0),
            *kind_of(hints_of(cls)[field.name]),
            field.metadata.get("packed", False),
            field.default,
        )
        for field in dataclasses.fields(cls)
        if field.name != "blocks"
    }


def written_name(name: str) -> str:
    """Name of a Python field in files."""
    return name.removesuffix("_")


@functools.cache
def kind_of(hint: Any) -> tuple[Any, bool]:
    """The kind of one value of a field, and whether the field is repeated."""
    if hint in ARRAYS:
        return hint, True
    if typing.get_origin(hint) is tuple:
        return typing.get_args(hint)[0], True
    if typing.get_origin(hint) in (types.UnionType, typing.Union):
        return kind_of(next(k for k in typing.get_args(hint) if k is not type(None)))
    return hint, False


@functools.cache
def enum_of(kind: Any) -> dict[str, int]:
    """The names of an enum with their numbers; empty for other kinds."""
    first = 0
    names: tuple[Any, ...] = ()
    if typing.get_origin(kind) is Annotated:
        kind, more = typing.get_args(kind)[:2]
        first = 1 if more == "from 1" else 0
        names = more if isinstance(more, tuple) else ()
    if typing.get_origin(kind) is Literal:
        names = typing.get_args(kind)
    return {str(name): number for number, name in enumerate(names, first)}


@functools.cache
def is_message(kind: Any) -> bool:
    """Whether a kind is a nested message: a dataclass or an unparsed tree."""
    return kind is Message or (isinstance(kind, type) and dataclasses.is_dataclass(kind))


# ------------------------------------------------------------------------------------- tree → typed


def read(message: Message, cls: type[T], what: str | None = None) -> T:
    """Fill the dataclass ``cls`` from a tree.

    Raises PrototxtError with the position of the mistake.
    """
    known = fields_of(cls)  # type: ignore[arg-type]
    takes_blocks = "blocks" in hints_of(cls)  # type: ignore[arg-type]
    found: dict[str, list[Field]] = {}
    blocks: dict[str, list[Message]] = {}
    for item in message.fields:
        if isinstance(item.value, Unknown):
            continue
        if item.name in known:
            found.setdefault(item.name, []).append(item)
        elif forks.has_no_effect(cls.__name__, item):
            continue
        elif takes_blocks and item.name.endswith("_param") and isinstance(item.value, Message):
            blocks.setdefault(item.name, []).append(item.value)
        else:
            raise unknown_field(item, known, cls.__name__)
    values: dict[str, Any] = {
        known[name].attribute: _field_value(items, known[name]) for name, items in found.items()
    }
    for name, info in known.items():
        if name in found:
            continue
        if info.default is dataclasses.MISSING:
            raise PrototxtError(
                message.position, f"missing required field {name!r} in {what or cls.__name__}"
            )
        if info.kind is float and isinstance(info.default, float):
            values[info.attribute] = round_to_32_bits(info.default)
    if takes_blocks:
        values["blocks"] = {name: _merged(parts) for name, parts in blocks.items()}
    return placed(cls(**values), message)


def unknown_field(item: Field, known: typing.Iterable[str], message: str) -> PrototxtError:
    """The error for an unknown field of the named message."""
    if effect := forks.effect_of(message, item.name):
        return PrototxtError(item.position, f"unknown option {item.name!r} {effect}")
    advice = meant_or_known(item.name, known, "known fields:")
    return PrototxtError(item.position, f"unknown field {item.name!r}{advice}")


def _field_value(items: Sequence[Field], info: FieldInfo) -> Any:
    kind = info.kind
    if kind in ARRAYS:
        return array_of(items, kind)
    if info.repeated:
        return tuple(value_of(item, kind) for item in items)
    first, *others = items
    if others and not is_message(kind):
        raise PrototxtError(
            others[0].position, f"field {first.name!r} is given twice, but is not a repeated field"
        )
    if others:
        first = Field(first.name, _merged([message_of(item) for item in items]), first.position)
    return value_of(first, kind)


def _merged(parts: Sequence[Message]) -> Message:
    """Merge the parts of a message that is given several times, as protobuf does."""
    return Message([field for part in parts for field in part.fields], parts[0].position)


def array_of(items: Sequence[Field], kind: Any) -> NDArray[Any]:
    """All values of an array field. Raises PrototxtError."""
    parts = [
        i.value.array if isinstance(i.value, Numbers) else np.array([value_of(i, Double)])
        for i in items
    ]
    return (parts[0] if len(parts) == 1 else np.concatenate(parts)).astype(ARRAYS[kind], copy=False)


def message_of(item: Field) -> Message:
    """The message in a field. Raises PrototxtError if it has another value."""
    if not isinstance(item.value, Message):
        found = f"expected {item.name} {{ ... }}, found {item.value}"
        raise PrototxtError(item.position, f"{item.name!r} is a message: {found}")
    return item.value


def value_of(item: Field, kind: Any) -> Any:
    """The value of a field of this kind. Raises PrototxtError."""
    value = item.value
    position = item.position
    if is_message(kind):
        return message_of(item) if kind is Message else read(message_of(item), kind, item.name)
    if not isinstance(value, Scalar):
        raise PrototxtError(
            position, f"{item.name!r} is not a message: expected '{item.name}: {expected(kind)}'"
        )
    result = scalar_value(value, kind)
    if result is None:
        if names := enum_of(kind):
            advice = meant_or_known(value.text, names, "known values:")
            raise wrong_name(value, item.name, advice)
        raise PrototxtError(
            value.position, f"{item.name!r} expects {expected(kind)}, found {value}"
        )
    return result


def wrong_name(value: Scalar, field: str, advice: str) -> PrototxtError:
    """The error for a value that is not a name of the field's enum."""
    found = f"unknown value {value} of {field!r}{advice}"
    if value.kind == "string":
        found = f"{field!r} expects a name without quotes, found {value}{advice}"
    return PrototxtError(value.position, found)


def expected(kind: Any) -> str:
    """Describe the expected values of this kind."""
    if names := enum_of(kind):
        return " or ".join(names)
    if kind in INTEGERS:
        return f"an integer from {INTEGERS[kind][0]} to {INTEGERS[kind][-1]}"
    return {
        str: "a string in quotes",
        bytes: "a string in quotes",
        bool: "true or false",
        float: "a number",
        Double: "a number",
    }[kind]


def scalar_value(value: Scalar, kind: Any) -> Any:
    """The Python value of a scalar; None if it is of another kind."""
    if kind is bytes:
        if isinstance(value, Bytes):
            return value.content
        return value.text.encode("utf-8", "surrogateescape") if value.kind == "string" else None
    if kind is str:
        return value.text if value.kind == "string" else None
    if value.kind == "string":
        return None
    if kind is bool:
        return value.truth()
    if names := enum_of(kind):
        if value.kind == "word":
            if kind == Engine and value.text in forks.ENGINES:
                return "DEFAULT"
            return value.text if value.text in names else None
        number = value.integer()
        return next((name for name, n in names.items() if n == number), None)
    if kind is Double:
        return _float(value)
    if kind is float:
        double = _float(value)
        return None if double is None else round_to_32_bits(double)
    number = value.integer()
    return number if number is not None and number in INTEGERS[kind] else None


def round_to_32_bits(number: float) -> float:
    """Round to a 32-bit float; too large numbers become infinite."""
    with np.errstate(over="ignore"):
        return float(np.float32(number))


def _float(value: Scalar) -> float | None:
    integer = value.integer()
    if integer is not None:
        return float(integer)
    text = value.text.lower()
    try:
        return float(text if value.kind == "word" else text.removesuffix("f"))
    except ValueError:  # of words, Python knows inf, infinity and nan, as protobuf does
        return None


# -------------------------------------------------------------------------------------------- typed


def tree_of(message: object) -> Message | None:
    """The tree that a typed message was read from."""
    return getattr(message, "_tree", None)


def placed(made: T, tree: Message | None) -> T:
    """Set the tree from which ``made`` counts as read, with the positions of its fields, and
    return ``made``.
    """
    object.__setattr__(made, "_tree", tree)
    return made


def position_of(message: object, name: str | None = None, index: int = 0) -> Place:
    """Position of a typed message, or of one of its fields, in its file."""
    tree = tree_of(message)
    if tree is None:
        return Position("<built in code>", 1, 1)
    places = [f.position for f in tree.fields if f.name == name]
    return places[index] if index < len(places) else tree.position


def is_given(message: object, name: str) -> bool:
    """Whether a field is given in the file."""
    tree = tree_of(message)
    return tree is not None and bool(tree.values(name))


def is_set(message: object, name: str) -> bool:
    """Whether a field is given in the file or, in a message made by a program, differs
    from its default.
    """
    return is_given(message, name) or getattr(message, name) != getattr(type(message), name)


def changed(message: T, **changes: Any) -> T:
    """Replace fields of a message; its position in the file is kept."""
    return placed(dataclasses.replace(message, **changes), tree_of(message))  # type: ignore[type-var]


def with_values(message: T, **values: Any) -> T:
    """Set fields of a message from Python values, checked like those of a file.

    Raises PrototxtError.
    """
    known = fields_of(type(message))  # type: ignore[arg-type]
    found: dict[str, Any] = {}
    for name, value in values.items():
        place = position_of(message, name)
        info = known.get(written_name(name))
        if info is None:
            raise PrototxtError(place, f"unknown field {name!r}{did_you_mean(name, known)}")
        if value is None and info.default is None:
            found[name] = None
            continue
        several = info.repeated and isinstance(value, (list, tuple))
        items = tuple(_python_value(one, info.kind) for one in (value if several else [value]))
        if info.repeated != several or None in items:
            what = "a message" if is_message(info.kind) else expected(info.kind)
            each = "a list, each " if info.repeated else ""
            raise PrototxtError(place, f"{name!r} expects {each}{what}, found {value!r}")
        found[name] = items if several else items[0]
    return changed(message, **found)


def _python_value(value: Any, kind: Any) -> Any:
    """Convert a Python value to that of a field of this kind; None if it is of another kind."""
    if is_message(kind):
        return value if isinstance(value, kind) else None
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, os.PathLike):
        value = os.fspath(value)
    if not isinstance(value, (int, float, str)) or isinstance(value, bool) != (kind is bool):
        return None
    written = _tree_value(value, Double if kind is float else kind, Place(""))
    return scalar_value(written, kind) if isinstance(written, Scalar) else None


# ------------------------------------------------------------------------------------- typed → tree


def to_tree(message: Any) -> Message:
    """Convert a typed message to a tree with the fields that its file gives or that differ from
    their defaults, and the unknown fields of a binary file.
    """
    place = position_of(message)
    tree = tree_of(message)
    fields: list[Field] = []
    for name, info in fields_of(message.__class__).items():
        value = getattr(message, info.attribute)
        kind = info.kind
        if value is not None and (
            info.default is None or value != info.default or is_given(message, name)
        ):
            whole = [Numbers(value, place)] if kind in ARRAYS else [value]
            values = value if info.repeated and kind not in ARRAYS else whole
            fields += [Field(name, _tree_value(one, kind, place), place) for one in values]
    for block, options in getattr(message, "blocks", {}).items():
        fields.append(Field(block, options, options.position))
    return Message(fields + (tree.unknown() if tree else []), place)


def _tree_value(value: Any, kind: Any, place: Place) -> Scalar | Numbers | Message:
    if isinstance(value, (Numbers, Message)):
        return value
    if is_message(kind):
        return to_tree(value)
    if isinstance(value, bytes):
        value = value.decode("utf-8", "surrogateescape")
    if isinstance(value, str):
        return Scalar("word" if enum_of(kind) else "string", value, place)
    if isinstance(value, bool):
        return Scalar("word", str(value).lower(), place)
    text = str(np.float32(value)) if kind is float else repr(value)
    if isinstance(value, int) or np.isfinite(value):
        return Scalar("number", text, place)
    return Scalar("word", text, place)  # infinity and NaN
