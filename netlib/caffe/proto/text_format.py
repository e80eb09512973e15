"""Replacement of google.protobuf.text_format for Caffe's messages, if the package protobuf is not installed."""

from __future__ import annotations

from typing import Any, TypeVar

from netlib.caffe.proto.message import Message
from netlib.errors import PrototxtError as ParseError
from netlib.proto import prototxt

M = TypeVar("M", bound=Message)


def Merge(text: str | bytes, message: M, **options: Any) -> M:
    """Merge the fields of a prototxt into a message. Raises ParseError."""
    message.merge_tree(prototxt.parse(text.decode("utf-8") if isinstance(text, bytes) else text))
    return message


def Parse(text: str | bytes, message: M, **options: Any) -> M:
    """Like ``Merge``. If a field is given twice, the last value is used, whereas protobuf's Parse rejects it."""
    return Merge(text, message)


def MessageToString(message: Message, **options: Any) -> str:
    """Convert a message to prototxt."""
    return str(message)


def PrintMessage(message: Message, out: Any, **options: Any) -> None:
    """Write a message to a file as prototxt."""
    out.write(str(message))


__all__ = ["Merge", "MessageToString", "Parse", "ParseError", "PrintMessage"]
