"""Descriptions of messages, with the interface of protobuf's descriptors.

Implements what scripts and google.protobuf.text_format use.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from typing import Any

from netlib.proto import schema
from netlib.proto.wire import FieldInfo

# FieldDescriptor.TYPE_* and CPPTYPE_* of protobuf
_TYPES = {float: (2, 6), schema.Double: (1, 5), schema.Floats: (2, 6), schema.Doubles: (1, 5), int: (5, 1),
          schema.Natural: (5, 1), schema.UInt: (13, 3), schema.Int64: (3, 2), bool: (8, 7), str: (9, 9),
          bytes: (12, 9)}  # fmt: skip
_ENUM, _MESSAGE = (14, 8), (11, 10)
_DEFAULTS: dict[Any, Any] = {float: 0.0, schema.Double: 0.0, bool: False, str: "", bytes: b""}
_DEFAULTS |= dict.fromkeys(schema.INTEGERS, 0)


class EnumValue:
    """One value of an enum."""

    def __init__(self, name: str, number: int, index: int) -> None:
        self.name, self.number, self.index = name, number, index


class EnumType:
    """An enum, which is also its own descriptor.

    numbers   name -> number
    names     number -> name
    """

    def __init__(self, name: str, values: Mapping[str, int]) -> None:
        self.name = self.full_name = name
        self.numbers, self.names = dict(values), {number: value for value, number in values.items()}
        self.values_by_name = {n: EnumValue(n, number, i) for i, (n, number) in enumerate(values.items())}
        self.values_by_number = {value.number: value for value in self.values_by_name.values()}
        self.is_closed = True
        self.DESCRIPTOR = self

    def Name(self, number: int) -> str:
        """Name of a value."""
        if number not in self.names:
            raise ValueError(f"enum {self.name} has no value {number}")
        return self.names[number]

    def Value(self, name: str) -> int:
        """Number of a value."""
        if name not in self.numbers:
            raise ValueError(f"enum {self.name} has no value {name!r}; it has {', '.join(self.numbers)}")
        return self.numbers[name]

    def keys(self) -> list[str]:
        """All names."""
        return list(self.numbers)

    def values(self) -> list[int]:
        """All numbers."""
        return list(self.numbers.values())

    def items(self) -> list[tuple[str, int]]:
        """Names with numbers."""
        return list(self.numbers.items())

    def __getattr__(self, name: str) -> int:
        if name.startswith("__") or name not in self.__dict__.get("numbers", {}):
            raise AttributeError(f"enum has no value {name!r}")
        return int(self.numbers[name])


class FieldDescriptor:
    """A field of a message.

    kind           as in netlib/proto/schema.py; the dataclass of a nested message
    default_value  value if the field is not set
    message_class  the class of a nested message
    """

    LABEL_OPTIONAL, LABEL_REQUIRED, LABEL_REPEATED = 1, 2, 3
    containing_oneof = None
    is_extension = False
    extension_scope = None
    has_options = False
    is_required = False

    def __init__(self, known: FieldInfo, enum: EnumType | None, default: Any, class_of: Callable[[Any], Any]) -> None:
        self.name = self.full_name = self.camelcase_name = self.json_name = known.name
        self.number, self.kind, self.is_repeated, self.enum_type = known.number, known.kind, known.repeated, enum
        self.label = self.LABEL_REPEATED if self.is_repeated else self.LABEL_OPTIONAL
        self.has_presence = not self.is_repeated
        self._class_of = class_of
        is_message = schema.is_message(self.kind)
        self.type, self.cpp_type = _MESSAGE if is_message else _ENUM if enum is not None else _TYPES[self.kind]
        is_scalar = not self.is_repeated and not is_message
        self.has_default_value = is_scalar and default not in (None, dataclasses.MISSING)
        self.default_value: Any = []
        if is_scalar and enum is not None:  # the default of an enum is its first value
            self.default_value = enum.numbers[default] if self.has_default_value else min(enum.names)
        elif is_scalar:
            self.default_value = default if self.has_default_value else _DEFAULTS[self.kind]

    @property
    def message_class(self) -> Any:
        """Class of a nested message."""
        return self._class_of(self.kind)

    @property
    def message_type(self) -> Descriptor | None:
        """Descriptor of a nested message."""
        return self.message_class.DESCRIPTOR if schema.is_message(self.kind) else None

    def GetOptions(self) -> None:
        """Return None: options are not supported."""


class Descriptor:
    """Description of a message, with its fields in the order of their numbers."""

    has_options = False
    is_extendable = False
    containing_type = None
    file = None

    def __init__(self, name: str, fields: list[FieldDescriptor], concrete: type) -> None:
        self.name, self.full_name = name, f"caffe.{name}"
        self.fields = fields
        self.fields_by_name = {field.name: field for field in fields}
        self.fields_by_number = {field.number: field for field in fields}
        self.enum_types_by_name = {f.enum_type.name: f.enum_type for f in fields if f.enum_type is not None}
        self.oneofs_by_name: dict[str, Any] = {}
        self.extensions_by_name: dict[str, Any] = {}
        self._concrete_class = concrete

    def GetOptions(self) -> None:
        """Return None: options are not supported."""
