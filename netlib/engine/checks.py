"""Checks around the methods of layers: errors name the layer."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from netlib.blob import Blob, Blobs
from netlib.errors import NetlibError
from netlib.layer import Layer, warn
from netlib.system import memory
from netlib.system.memory import OutOfMemoryError

ADVICE = "; use a smaller batch or layer"
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
        if isinstance(error, NetlibError) and not isinstance(error, OutOfMemoryError):
            raise
        if memory.is_lacking(error):
            raise lacking(layer, method, error) from error
        bottom = args[2 if method == "backward" else 0]
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


def lacking(layer: Layer, what: str, error: Exception) -> OutOfMemoryError:
    """The error for a layer that lacks memory, with its name unless ``error`` has it."""
    if str(error).endswith(ADVICE):
        return OutOfMemoryError(str(error))
    needs = str(error) if isinstance(error, OutOfMemoryError) else f"needs more memory than there is: {error}"
    return OutOfMemoryError(str(layer.fail(f"{what}: {needs.removesuffix(': ')}{ADVICE}")))


def check_memory(connections: Sequence[Connected], hidden: Iterable[Blob]) -> None:
    """Raise OutOfMemoryError if the parameters and the tops of all layers together do not fit in memory.

    ``hidden`` are blobs that the engine does not store.
    """
    writers = {top: at.layer for at in connections for top in at.top}
    for blob in hidden:
        writers.pop(blob, None)
    params = {blob for at in connections for blob in at.layer.blobs}
    try:
        memory.check(sum(blob.bytes for blob in [*params, *writers] if blob.owns_memory), "for all blobs of the net")
    except OutOfMemoryError as error:
        raise lacking(writers[max(writers, key=lambda top: top.bytes)], "forward", error) from error
