"""Mutable messages with the interface of protobuf's classes.

Each class is generated from a dataclass that reads prototxt (netlib/proto/schema.py), so a field is declared only once.
As in protobuf, an unset scalar returns its default, a nested message becomes set when one of its fields is set,
repeated fields are lists that check their elements, and messages are copied on assignment.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from typing import Any, ClassVar

from netlib.caffe.proto.descriptor import Descriptor, EnumType, FieldDescriptor
from netlib.caffe.proto.values import FloatList, checked, container
from netlib.errors import WireError
from netlib.proto import prototxt, schema, wire
from netlib.proto.prototxt import Field, Numbers, Position, Scalar
from netlib.proto.schema import ARRAYS

BUILT = Position("<built in code>", 1, 1)


class Message:
    """A message; its fields are attributes. Fields may be given by name: ``ParamSpec(lr_mult=2)``."""

    DESCRIPTOR: ClassVar[Descriptor]
    dataclass: ClassVar[type]  # the dataclass that the class was generated from

    def __init__(self, **fields: Any) -> None:
        object.__setattr__(self, "_values", {})
        object.__setattr__(self, "_present", False)
        object.__setattr__(self, "_owner", lambda: None)
        for name, value in fields.items():
            self._give(name, value)

    def _give(self, name: str, value: Any) -> None:
        """Set a field of any kind from an argument of the constructor."""
        field = self._field(name)
        if field.is_repeated:
            getattr(self, name).extend(value)
        elif field.message_type is not None:
            if isinstance(value, Mapping):
                value = field.message_class(**value)
            getattr(self, name).CopyFrom(value)
        else:
            setattr(self, name, value)

    def _field(self, name: str) -> FieldDescriptor:
        field = self.DESCRIPTOR.fields_by_name.get(name)
        if field is None:
            raise AttributeError(f"a {self.DESCRIPTOR.name} has no field {name!r}")
        return field

    def __getattr__(self, name: str) -> Any:
        field = self._field(name)
        if name not in self._values:
            if field.is_repeated:
                self._values[name] = container(field, self._touch)
            elif field.message_type is not None:
                self._values[name] = field.message_class()
                object.__setattr__(self._values[name], "_owner", self._touch)
            else:
                return field.default_value
        return self._values[name]

    def __setattr__(self, name: str, value: Any) -> None:
        field = self._field(name)
        if field.is_repeated or field.message_type is not None:
            what = "a repeated field" if field.is_repeated else "a message"
            raise AttributeError(f"{name!r} of {self.DESCRIPTOR.name} is {what} and cannot be assigned; change it")
        self._values[name] = checked(field, value)
        self._touch()

    def __delattr__(self, name: str) -> None:
        self.ClearField(name)

    def _touch(self) -> None:
        """Mark this message as set, and those that contain it."""
        if not self._present:
            object.__setattr__(self, "_present", True)
        self._owner()

    # Names from here on are those of protobuf.

    SetInParent = _touch

    def HasField(self, name: str) -> bool:
        """Whether a field that is not repeated is set."""
        field = self.DESCRIPTOR.fields_by_name.get(name)
        if field is None or field.is_repeated:
            raise ValueError(f"{self.DESCRIPTOR.name} has no field {name!r} that is not repeated")
        if field.message_type is not None:
            return name in self._values and self._values[name]._present
        return name in self._values

    def ClearField(self, name: str) -> None:
        """Clear a field."""
        self._field(name)
        self._values.pop(name, None)
        self._touch()

    def Clear(self) -> None:
        """Clear all fields."""
        self._values.clear()
        self._touch()

    def ListFields(self) -> list[tuple[FieldDescriptor, Any]]:
        """Fields that are set, with their values, in the order of the fields' numbers."""
        return [(f, self._values[f.name]) for f in self.DESCRIPTOR.fields if self._is_set(f)]

    def _is_set(self, field: FieldDescriptor) -> bool:
        if field.is_repeated:
            return field.name in self._values and len(self._values[field.name]) > 0
        return self.HasField(field.name)

    def CopyFrom(self, other: Message) -> None:
        """Replace the content by that of another message of this type."""
        if other is not self:
            self.Clear()
            self.MergeFrom(other)

    def MergeFrom(self, other: Message) -> None:
        """Copy the set fields of another message of this type; repeated fields are appended."""
        if type(other) is not type(self):
            raise TypeError(f"expected a {self.DESCRIPTOR.name}, found {type(other).__name__}")
        self._touch()
        for field, value in other.ListFields():
            if field.is_repeated:
                getattr(self, field.name).extend(value)
            elif field.message_type is not None:
                getattr(self, field.name).MergeFrom(value)
            else:
                setattr(self, field.name, value)

    def SerializeToString(self, **options: Any) -> bytes:
        """Encode in protocol buffers' binary format."""
        return wire.encode(self.to_tree(), self.dataclass)

    SerializePartialToString = SerializeToString

    def ParseFromString(self, data: bytes) -> int:
        """Replace the content by that of an encoded message. Raises WireError."""
        self.Clear()
        return self.MergeFromString(data)

    @classmethod
    def FromString(cls, data: bytes) -> Message:
        """Decode a message. Raises WireError."""
        made = cls()
        made.MergeFromString(data)
        return made

    def MergeFromString(self, data: bytes) -> int:
        """Merge the fields of an encoded message; returns the number of bytes. Raises WireError."""
        if not isinstance(data, (bytes, bytearray, memoryview)):
            raise TypeError(f"expected bytes, found {type(data).__name__}; open binary files with 'rb'")
        data = bytes(data)
        try:
            self.merge_tree(wire.decode(data, self.dataclass))
        except WireError as error:
            raise WireError(f"not a {self.DESCRIPTOR.name}: {error}") from None
        return len(data)

    def ByteSize(self) -> int:
        """Size of the encoded message in bytes."""
        return len(self.SerializeToString())

    def IsInitialized(self, *errors: Any) -> bool:
        """Return True: scripts do not rely on Caffe's required fields."""
        return True

    def FindInitializationErrors(self) -> list[str]:
        """Return an empty list, as all messages count as initialized."""
        return []

    def UnknownFields(self) -> list[Any]:
        """Return an empty list, as unknown fields are dropped."""
        return []

    def WhichOneof(self, name: str) -> None:
        """Raise ValueError, as Caffe's messages have no oneof."""
        raise ValueError(f"{self.DESCRIPTOR.name} has no oneof {name!r}")

    def __eq__(self, other: object) -> bool:
        return type(other) is type(self) and self.SerializeToString() == other.SerializeToString()

    __hash__ = None  # type: ignore[assignment]

    def __str__(self) -> str:
        return str(self.to_tree())

    __repr__ = __str__

    def __deepcopy__(self, memo: Any) -> Message:
        copy = type(self)()
        copy.CopyFrom(self)
        return copy

    def __dir__(self) -> list[str]:
        return [*super().__dir__(), *self.DESCRIPTOR.fields_by_name]

    def __reduce__(self) -> Any:
        return type(self).FromString, (self.SerializeToString(),)

    # ------------------------------------------------------------------------------------------ as a tree

    def to_tree(self) -> prototxt.Message:
        """Convert to a tree like that of the prototxt parser, with fields in the order of their numbers."""
        fields: list[Field] = []
        for field, value in self.ListFields():
            if isinstance(value, FloatList):
                fields.append(Field(field.name, Numbers(value.array, BUILT), BUILT))
            else:
                values = value if field.is_repeated else [value]
                fields += [Field(field.name, _as_node(field, one), BUILT) for one in values]
        return prototxt.Message(fields, BUILT)

    def merge_tree(self, tree: prototxt.Message) -> None:
        """Merge the fields of a tree. Raises PrototxtError for an unknown field."""
        self._touch()
        for item in tree.fields:
            if isinstance(item.value, prototxt.Unknown):
                continue
            field = self.DESCRIPTOR.fields_by_name.get(item.name)
            if field is None:
                raise schema.unknown_field(item, self.DESCRIPTOR.fields_by_name)
            if field.message_type is not None:
                target = getattr(self, item.name)
                (target.add() if field.is_repeated else target).merge_tree(schema.message_of(item))
            elif isinstance(item.value, Numbers):
                getattr(self, item.name).extend(item.value.array)
            else:
                value = schema.value_of(item, schema.Double if field.kind in ARRAYS else field.kind)
                value = field.enum_type.numbers[value] if field.enum_type is not None else value
                if field.is_repeated:
                    getattr(self, item.name).append(value)
                else:
                    setattr(self, item.name, value)


def _as_node(field: FieldDescriptor, value: Any) -> Scalar | prototxt.Message:
    if isinstance(value, Message):
        return value.to_tree()
    if field.enum_type is not None:
        return Scalar("word", field.enum_type.names[value], BUILT)
    node: Scalar = schema.scalar_node(value, field.kind, BUILT)
    return node


# ---------------------------------------------------------------------------------------------- classes


def make_class(cls: type, name: str, enum_names: Mapping[str, str], class_of: Callable[[Any], type[Message]]) -> Any:
    """Generate the class of messages that a dataclass describes.

    ``enum_names`` maps fields to the names of their enums. ``class_of`` returns the class for a nested dataclass; it is
    called when such a field is used.
    """
    defaults = {schema.written_name(f.name): f.default for f in dataclasses.fields(cls)}
    fields: list[FieldDescriptor] = []
    for known in wire.fields_of(cls):
        values = schema.enum_of(known.kind)
        enum = EnumType(enum_names.get(known.name, known.name), values) if values else None
        fields.append(FieldDescriptor(known, enum, defaults.get(known.name), class_of))
    made = type(
        name, (Message,), {"dataclass": cls, "__doc__": cls.__doc__, "__module__": "netlib.caffe.proto.caffe_pb2"}
    )
    descriptor = Descriptor(name, sorted(fields, key=lambda field: field.number), made)
    type.__setattr__(made, "DESCRIPTOR", descriptor)
    for field in fields:
        type.__setattr__(made, f"{field.name.upper()}_FIELD_NUMBER", field.number)
        if field.enum_type is not None:
            type.__setattr__(made, field.enum_type.name, field.enum_type)
            for value, number in field.enum_type.numbers.items():
                type.__setattr__(made, value, number)
    return made
