"""Checks around the methods of layers: errors that name the layer, and, if memory is lacking, the option to lower."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from netlib.blob import Blob, Blobs
from netlib.errors import NetlibError
from netlib.layer import Layer, warn
from netlib.proto.options import block_name
from netlib.proto.prototxt import Field, Message, Scalar
from netlib.system import memory
from netlib.system.memory import OutOfMemoryError

UNWRITTEN = 1.2345678e-38  # a normal float32: adding to it, or multiplying it, gives in effect what 0 gives


class Connected(Protocol):
    """A layer with its bottom and top blobs."""

    layer: Layer
    bottom: Blobs
    top: Blobs


class Differentiable(Connected, Protocol):
    """A layer with its bottom and top blobs, and what its backward computes."""

    propagate_down: list[bool]
    has_run_back: bool  # whether backward was called before


def run_backward(at: Differentiable, instead: Layer | None = None) -> None:
    """Call a layer's backward, or that of the layer that computes it ``instead``.

    The first time, report each bottom diff that a Python layer leaves unwritten; its values are 0, as in Caffe.
    """
    marked = [] if at.has_run_back or at.layer.type != "Python" else [
        (name, blob) for name, blob, down in zip(at.layer.spec.bottom, at.bottom, at.propagate_down)
        if down and blob.count and blob not in at.top
    ]
    for _, blob in marked:
        blob.diff.fill(UNWRITTEN)
    guarded(instead or at.layer, "backward", at.top, at.propagate_down, at.bottom)
    at.has_run_back = True
    for name, blob in marked:
        unwritten = blob.diff == np.asarray(UNWRITTEN, blob.dtype)
        if unwritten.any():
            blob.diff[unwritten] = 0
            part = "the diff" if unwritten.all() else f"{unwritten.sum()} of {blob.count} values of the diff"
            warn(at.layer, f"backward of {type(at.layer).__name__} does not write {part} of bottom {name!r}; "
                           "what is not written is 0, as in Caffe: write every element, or set propagate_down: false")


def guarded(layer: Layer, method: str, *args: Any) -> None:
    """Call a method of a layer and convert Python errors to LayerErrors that name the layer."""
    try:
        getattr(layer, method)(*args)
    except Exception as error:
        bottom, top = reversed(args[::2]) if method == "backward" else args
        if memory.is_lacking(error) and not (isinstance(error, OutOfMemoryError) and error.in_layer):
            raise error_of(layer, method, bottom, top, error) from error
        if isinstance(error, NetlibError):
            raise
        for name, blob in zip(layer.spec.bottom, bottom):
            if not blob.count and layer.type != "Python":  # the author of a Python layer needs its own error
                raise layer.fail(f"bottom {name!r} {blob.shape} is empty; {layer.type} expects values") from error
        raise layer.fail(f"{method} failed: {type(error).__name__}: {error}{_place(error)}") from error


def _place(error: BaseException) -> str:
    """`` (file:line)`` of the innermost call that failed."""
    trace = error.__traceback__
    while trace is not None and trace.tb_next is not None:
        trace = trace.tb_next
    return f" ({Path(trace.tb_frame.f_code.co_filename).name}:{trace.tb_lineno})" if trace else ""


def check_memory(connections: Sequence[Connected], hidden: Iterable[Blob]) -> None:
    """Raise OutOfMemoryError if the parameters and the tops of all layers together do not fit in memory.

    ``hidden`` are blobs that the engine does not store.
    """
    writers = {top: at for at in connections for top in at.top}
    for blob in hidden:
        writers.pop(blob, None)
    params = {blob for at in connections for blob in at.layer.blobs}
    try:
        total = sum(blob.bytes for blob in [*params, *writers] if blob.owns_memory)
        memory.check(total, "for parameters and blobs of the net in total")
    except OutOfMemoryError as error:
        if not writers:
            raise
        top = max(writers, key=lambda top: (largest_option(writers[top].layer) is not None, top.bytes))
        at, what = writers[top], f"{memory.format_bytes(top.bytes)}, of {error}"
        raise error_of(at.layer, "forward", at.bottom, at.top, OutOfMemoryError(what, top)) from error


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
