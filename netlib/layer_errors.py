"""Errors of layers: what a method of a layer raises becomes one line that names the layer
and the place.
"""

from __future__ import annotations

import sysconfig
import traceback
from contextlib import AbstractContextManager
from pathlib import Path
from types import TracebackType

from netlib.blob import Blobs
from netlib.errors import NetlibError
from netlib.layer import Layer
from netlib.system import memory
from netlib.system.memory import OutOfMemoryError

ADVICE = "; use a smaller batch or layer"
# not the user's files
LIBRARIES = ("<", *(sysconfig.get_path(name) for name in ("stdlib", "purelib", "platlib")))


class LayerErrors(AbstractContextManager[None]):
    """Context manager around methods of a layer: errors of Python become LayerErrors that name the
    layer, the method and the innermost line that is not of a library.
    """

    def __init__(self, layer: Layer, bottom: Blobs) -> None:
        self.layer = layer
        self.bottom = bottom

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if error is None or trace is None or not isinstance(error, Exception):
            return
        if isinstance(error, NetlibError) and not isinstance(error, OutOfMemoryError):
            return
        method = (trace.tb_next or trace).tb_frame.f_code.co_name
        if memory.is_lacking(error):
            raise lacking(self.layer, method, error) from error
        for name, blob in zip(self.layer.spec.bottom, self.bottom):
            # the author of a Python layer needs its own error
            if not blob.count and self.layer.type != "Python":
                raise self.layer.fail(
                    f"bottom {name!r} {blob.shape} is empty; {self.layer.type} expects values"
                ) from error
        # by its class, because a Python layer may have an attribute of this name
        raise Layer.fail(
            self.layer, f"{method} failed: {type(error).__name__}: {error}{_place(trace)}"
        ) from error


def _place(trace: TracebackType) -> str:
    """`` (file:line)`` of the innermost call in a file of the user or of this project."""
    calls = traceback.extract_tb(trace)
    own = [call for call in calls[1:] if not call.filename.startswith(LIBRARIES)]
    at = (own or calls)[-1]
    return f" ({Path(at.filename).name}:{at.lineno})"


def lacking(layer: Layer, what: str, error: Exception) -> OutOfMemoryError:
    """The error for a layer that lacks memory, with its name unless ``error`` has it."""
    if str(error).endswith(ADVICE):
        return OutOfMemoryError(str(error))
    needs = (
        str(error)
        if isinstance(error, OutOfMemoryError)
        else f"needs more memory than there is: {error}"
    )
    return OutOfMemoryError(str(layer.fail(f"{what}: {needs.removesuffix(': ')}{ADVICE}")))
