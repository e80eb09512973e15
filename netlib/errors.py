"""The error kinds of the project. Each message is one line a user can act on.

A message says what was found, where (``file:line:column``, layer, blob, field), what was expected
and, if it helps, what to do. Tools print it to stderr and exit with status 1.
"""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable

LONGEST = 2000  # characters of a message
OF_FORKS = ("BN", "bn_param")  # a layer type that Caffe does not have, and its options


class NetlibError(RuntimeError):  # which is what pycaffe raises
    """Base of every error that a user's input can cause."""

    def __init__(self, message: str = "") -> None:
        if len(message := printable(message)) > LONGEST:  # a file may hold a name of any length
            message = f"{message[: LONGEST - 300]} ... ({len(message)} characters) ... {message[-200:]}"
        super().__init__(message)


class PrototxtError(NetlibError):
    """Text that is not a valid prototxt, or a field that its message does not have."""

    def __init__(self, position: object, message: str) -> None:
        super().__init__(f"{position}: error: {message}")


class WireError(NetlibError):
    """Bytes that are not a message in protocol buffers' binary format."""


class LayerError(NetlibError):
    """A layer that cannot be built or run: options, shapes or counts that do not fit."""


class WeightsError(NetlibError):
    """Weights or a solver state that cannot be read, written, or do not fit the net."""


class DataError(NetlibError):
    """A data set that is missing, unreadable or inconsistent."""


class DivergenceError(NetlibError):
    """Training met a value that is NaN or infinite."""


def printable(text: object) -> str:
    """What a log or a terminal may show: characters that act instead of being seen are escaped, as in Python's repr.

    Names in files may hold line ends, a terminal's commands, marks that turn the direction of writing, bytes that are
    no text.
    """
    return "".join(c if c.isprintable() else repr(c)[1:-1] for c in str(text))


def did_you_mean(name: str, known: Iterable[str]) -> str:
    """``" (did you mean 'x'?)"`` for the nearest of ``known``, or an empty string."""
    near = difflib.get_close_matches(name, list(known), n=1, cutoff=0.6)
    return f" (did you mean {near[0]!r}?)" if near else ""


def option_advice(name: str, known: Iterable[str]) -> str:
    """The same for what a prototxt says: a field, a layer type, a value. Names of Caffe's forks are known as such."""
    if name in OF_FORKS:
        return (" (the layer BN and its bn_param are of forks of Caffe, as SegNet's; "
                "expected two layers, BatchNorm and Scale with bias_term: true)")  # fmt: skip
    return did_you_mean(name, known)


def reason_of(error: BaseException | None) -> str:
    """Why something cannot be read or written, on one line: ``No space left on device``, ``not a text file``."""
    if isinstance(error, UnicodeDecodeError):
        return "not a text file"
    text = (error.strerror if isinstance(error, OSError) else None) or str(error)
    if wrapped := re.search(r"error message = '([^']*)'", text):  # HDF5 hides it in a long tale
        text = wrapped.group(1)
    return " ".join((text or type(error).__name__).split())
