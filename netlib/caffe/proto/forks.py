"""Fields of public forks of Caffe that scripts write to nets and solvers, and that layers of this
project do not read: forks.proto.

They are in caffe_pb2 and NetSpec only, so that a fork's scripts can write and parse its nets. A net
with them is an error where it is built, unless the option is one without effect
(netlib/proto/forks.py).
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

PATH = Path(__file__).with_name("forks.proto")


def add_to(file: Any) -> None:
    """Add the fields, messages and enums of forks.proto to a FileDescriptorProto."""
    opened = [file]  # from the file to the message or enum to which a line belongs
    for line in PATH.read_text(encoding="utf-8").splitlines():
        inner = opened[-1]
        match re.findall(r"[\w.]+|}", line.partition("//")[0]):
            case ["message", name]:
                known = inner.message_type if inner is file else inner.nested_type
                opened.append(_named(known, name))
            case ["enum", name]:
                opened.append(inner.enum_type.add(name=name))
            case ["optional" | "repeated" as label, kind, name, number]:
                _add_field(inner, label, kind, name, int(number))
            case [name, number]:
                inner.value.add(name=name, number=int(number))
            case ["}"]:
                opened.pop()


def _named(messages: Any, name: str) -> Any:
    """The message of this name, which is added unless it exists."""
    found = (message for message in messages if message.name == name)
    return next(found, None) or messages.add(name=name)


def _add_field(message: Any, label: str, kind: str, name: str, number: int) -> None:
    field = message.field.add(name=name, number=number)
    field.label = getattr(field, f"LABEL_{label.upper()}")
    scalar = getattr(field, f"TYPE_{kind.upper()}", None)
    if scalar is None:
        field.type_name = kind  # protobuf looks it up in the message, then in the file
    else:
        field.type = scalar
