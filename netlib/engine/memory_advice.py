"""Out-of-memory errors of an engine: which layer failed, and which option to lower."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator

from netlib.layer import Layer
from netlib.proto.options import block_name
from netlib.proto.prototxt import Field, Message, Scalar
from netlib.system.memory import OutOfMemoryError


def error_of(
    layer: Layer, method: str, bottom: Iterable[object], top: Iterable[object], error: Exception
) -> OutOfMemoryError:
    """The error for a layer whose ``method`` ran out of memory, with its place and the option to lower."""
    if isinstance(error, OutOfMemoryError):
        what = str(error)
        names = [*zip(layer.spec.top, top), *zip(layer.spec.bottom, bottom)]
        what = next((f"blob {name!r}: {what}" for name, blob in names if blob is error.blob), what)
    else:
        what = f"{method} needs more memory than there is{f': {error}' if str(error) else ''}"
    option = largest_option(layer)
    advice, place = (f"lower {option.name}", option.position) if option else ("lower the batch size", None)
    return OutOfMemoryError(str(layer.fail(f"{what}: {advice}", at=place)), in_layer=True)


def largest_option(layer: Layer) -> Field | None:
    """The option with the largest whole number in the layer's block; None if all are below 1000."""
    block = layer.spec.blocks.get(block_name(type(layer), layer.spec.type))
    numbers = [(n, i, field) for i, (n, field) in enumerate(_numbers(block))] if block else []
    return max(numbers)[2] if numbers else None


def _numbers(block: Message) -> Iterator[tuple[int, Field]]:
    """Whole numbers of at least 1000 in an options block."""
    for field in block.fields:
        if isinstance(field.value, Message):
            yield from _numbers(field.value)
        elif isinstance(field.value, Scalar) and re.fullmatch(r"[1-9]\d{3,19}", field.value.text):
            yield int(field.value.text), field
