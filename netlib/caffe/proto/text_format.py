"""google.protobuf.text_format for Caffe's messages, for where the package protobuf is not installed."""

from __future__ import annotations

from typing import Any, TypeVar

from netlib.caffe.proto.message import Message
from netlib.errors import PrototxtError as ParseError
from netlib.proto import prototxt

M = TypeVar("M", bound=Message)


def Merge(text: str | bytes, message: M, **options: Any) -> M:
    """Take the fields of a prototxt. Raises ParseError."""
    message.merge_tree(prototxt.parse(text.decode("utf-8") if isinstance(text, bytes) else text))
    return message


def Parse(text: str | bytes, message: M, **options: Any) -> M:
    """The same; a field given twice takes its last value here, where protobuf's Parse refuses it."""
    return Merge(text, message)


def MessageToString(message: Message, **options: Any) -> str:
    """The prototxt of a message."""
    return str(message)


def PrintMessage(message: Message, out: Any, **options: Any) -> None:
    """Write the prototxt of a message to a file."""
    out.write(str(message))


__all__ = ["Merge", "MessageToString", "Parse", "ParseError", "PrintMessage"]
