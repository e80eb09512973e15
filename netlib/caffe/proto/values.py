"""Values of message fields: checked scalars, and lists of scalars, numbers or messages.

``touch`` is called after every change, so that the message that contains the list is marked as set.
"""

from __future__ import annotations

import array
import numbers
from collections.abc import Callable, Iterable, Iterator, MutableSequence
from typing import Any

import numpy as np

from netlib.caffe.proto.descriptor import FieldDescriptor
from netlib.proto import schema
from netlib.proto.schema import ARRAYS, INTEGERS

Touch = Callable[[], None]
Message = Any  # of a class that message.py makes


def checked(field: FieldDescriptor, value: Any) -> Any:
    """Check and convert a value for a scalar field. Raises TypeError or ValueError."""
    kind = field.kind
    if field.enum_type is not None:
        number = field.enum_type.numbers.get(value) if isinstance(value, str) else value
        if not isinstance(number, numbers.Integral) or int(number) not in field.enum_type.names:
            raise ValueError(f"{field.name!r} is one of {', '.join(field.enum_type.numbers)}, found {value!r}")
        return int(number)
    if kind is str and isinstance(value, (str, bytes)):
        return value if isinstance(value, str) else value.decode("utf-8")
    if kind is bytes and isinstance(value, (bytes, bytearray)):
        return bytes(value)
    if kind is bool and isinstance(value, (numbers.Integral, np.bool_)):
        return bool(value)
    if kind in INTEGERS and isinstance(value, numbers.Integral):
        if int(value) not in INTEGERS[kind]:
            raise ValueError(f"{field.name!r} is {schema.expected(kind)}, found {value}")
        return int(value)
    if kind in (float, schema.Double) and isinstance(value, numbers.Real):
        return schema.round_to_32_bits(float(value)) if kind is float else float(value)
    raise TypeError(f"{field.name!r} is {schema.expected(kind)}, found {value!r} ({type(value).__name__})")


class RepeatedScalars(MutableSequence[Any]):
    """A list of scalars of one field."""

    def __init__(self, field: FieldDescriptor, touch: Touch) -> None:
        self._field, self._touch = field, touch
        self._list: list[Any] = []

    def __len__(self) -> int:
        return len(self._list)

    def __getitem__(self, index: Any) -> Any:
        return self._list[index]

    def __setitem__(self, index: Any, value: Any) -> None:
        if isinstance(index, slice):
            self._list[index] = [checked(self._field, one) for one in value]
        else:
            self._list[index] = checked(self._field, value)
        self._touch()

    def __delitem__(self, index: Any) -> None:
        del self._list[index]
        self._touch()

    def insert(self, index: int, value: Any) -> None:
        """Insert a value."""
        self._list.insert(index, checked(self._field, value))
        self._touch()

    def extend(self, values: Iterable[Any]) -> None:
        """Append values; None counts as no values."""
        self._list.extend([checked(self._field, value) for value in (() if values is None else values)])
        self._touch()

    MergeFrom = extend

    def __eq__(self, other: object) -> bool:
        return self._list == (other._list if isinstance(other, RepeatedScalars) else other)

    def __repr__(self) -> str:
        return repr(self._list)


class FloatList(MutableSequence[float]):
    """A list of numbers of one field, stored in an array because blobs can have millions."""

    def __init__(self, field: FieldDescriptor, touch: Touch) -> None:
        self._code = "f" if ARRAYS[field.kind].itemsize == 4 else "d"
        self._touch = touch
        self._items: Any = array.array(self._code)

    @property
    def array(self) -> np.ndarray[Any, Any]:
        """All numbers, without a copy."""
        return np.frombuffer(self._items, self._code) if self._items else np.zeros(0)

    def __array__(self, dtype: Any = None, copy: Any = None) -> np.ndarray[Any, Any]:
        found = np.array(self._items, dtype=self._code)  # a copy, because a view would prevent resizing the list
        return found if dtype is None else found.astype(dtype)

    def __len__(self) -> int:
        return len(self._items)

    def __getitem__(self, index: Any) -> Any:
        found = self._items[index]
        return found.tolist() if isinstance(index, slice) else found

    def __setitem__(self, index: Any, value: Any) -> None:
        self._items[index] = array.array(self._code, value) if isinstance(index, slice) else value
        self._touch()

    def __delitem__(self, index: Any) -> None:
        del self._items[index]
        self._touch()

    def insert(self, index: int, value: float) -> None:
        """Insert a number."""
        self._items.insert(index, value)
        self._touch()

    def extend(self, values: Iterable[float]) -> None:
        """Append numbers; arrays are converted as a whole."""
        if isinstance(values, FloatList):
            self._items.extend(array.array(self._code, values._items))
        elif isinstance(values, np.ndarray):
            self._items.frombytes(np.ascontiguousarray(values, self._code).tobytes())
        else:
            self._items.extend(array.array(self._code, list(values)))
        self._touch()

    MergeFrom = extend

    def __eq__(self, other: object) -> bool:
        return self._items.tolist() == (list(other) if isinstance(other, (FloatList, list, tuple)) else other)

    def __repr__(self) -> str:
        return repr(self._items.tolist())


class RepeatedMessages(MutableSequence[Message]):
    """A list of messages of one field; elements are copied when added."""

    def __init__(self, field: FieldDescriptor, touch: Touch) -> None:
        self._field, self._touch = field, touch
        self._list: list[Message] = []

    def add(self, **fields: Any) -> Message:
        """Append a new message and return it."""
        made: Message = self._field.message_class(**fields)
        object.__setattr__(made, "_owner", self._touch)
        self._list.append(made)
        self._touch()
        return made

    def _copy(self, message: Message) -> Message:
        made: Message = self._field.message_class()
        made.MergeFrom(message)
        object.__setattr__(made, "_owner", self._touch)
        return made

    def __len__(self) -> int:
        return len(self._list)

    def __getitem__(self, index: Any) -> Any:
        return self._list[index]

    def __setitem__(self, index: Any, value: Any) -> None:
        raise TypeError(f"{self._field.name!r} is a repeated message: use add(), append() or CopyFrom()")

    def __delitem__(self, index: Any) -> None:
        del self._list[index]
        self._touch()

    def insert(self, index: int, value: Message) -> None:
        """Insert a copy of a message."""
        self._list.insert(index, self._copy(value))
        self._touch()

    def extend(self, values: Iterable[Message]) -> None:
        """Append copies of messages."""
        self._list.extend([self._copy(value) for value in values])
        self._touch()

    MergeFrom = extend

    def sort(self, **options: Any) -> None:
        """Sort like a list."""
        self._list.sort(**options)

    def __iter__(self) -> Iterator[Message]:
        return iter(list(self._list))

    def __eq__(self, other: object) -> bool:
        return self._list == (other._list if isinstance(other, RepeatedMessages) else other)

    def __repr__(self) -> str:
        return repr(self._list)


def container(field: FieldDescriptor, touch: Touch) -> Any:
    """Create the empty list of a repeated field."""
    if field.message_type is not None:
        return RepeatedMessages(field, touch)
    return FloatList(field, touch) if field.kind in ARRAYS else RepeatedScalars(field, touch)
