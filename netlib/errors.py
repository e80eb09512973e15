"""The error classes of the project, and warnings.

Each message is one line that the user can act on.

A message says what was found, where (``file:line:column``, layer, blob, field), what was expected
and, if it helps, what to do. Tools print it to stderr and exit with status 1.
"""

from __future__ import annotations

import difflib
import errno
import functools
import logging
import re
from collections.abc import Iterable

MAX_NAMES = 8  # in a message


class NetlibError(RuntimeError):  # pycaffe raises RuntimeError
    """Base class of all errors that a user's input can cause."""

    def __init__(self, message: str = "") -> None:
        super().__init__(printable(message))


class PrototxtError(NetlibError):
    """Text that is not a valid prototxt, or a field that its message type does not define."""

    def __init__(self, position: object, message: str) -> None:
        super().__init__(f"{position}: error: {message}")


class WireError(NetlibError):
    """Bytes that are not a valid message in protocol buffers' binary format."""


class LayerError(NetlibError):
    """A layer that cannot be built or run because its options, shapes or counts
    are inconsistent.
    """


class WeightsError(NetlibError):
    """Weights or a solver state that cannot be read or written, or that do not match the net."""


class DataError(NetlibError):
    """A data set that is missing, unreadable or inconsistent."""


class DivergenceError(NetlibError):
    """A NaN or infinite value during training."""


def printable(text: object) -> str:
    """Escape all characters of ``text`` that are not printable, as Python's repr does.

    Names in files can contain line breaks, terminal escape sequences, marks that change the writing
    direction, and invalid bytes.
    """
    return "".join(c if c.isprintable() else repr(c)[1:-1] for c in str(text))


def did_you_mean(name: str, known: Iterable[str]) -> str:
    """Return ``" (did you mean 'x'?)"`` for the closest match in ``known``, or an empty string."""
    stem = name.removesuffix("_param")
    ending = name[len(stem) :]  # equal endings do not make names similar
    stems = [other.removesuffix(ending) for other in known if other.endswith(ending)]
    for near in difflib.get_close_matches(stem, stems, n=3, cutoff=0.6):
        begins_alike = near.startswith(stem) or stem.startswith(near)
        if (
            begins_alike
            or len(stem) < 4
            or difflib.SequenceMatcher(None, stem, near).ratio() >= 0.7
        ):
            return f" (did you mean {near + ending!r}?)"
    return ""


def meant_or_known(name: str, known: Iterable[str], what: str) -> str:
    """Return advice on an unknown name: the one that may be meant, else all that are known, as
    ``"; known types: x, y"``.
    """
    known = list(known)
    return did_you_mean(name, known) or f"; {what} {', '.join(known)}"


def some_of(names: Iterable[str]) -> str:
    """Return the first names of many and the number of the others, as ``"a, b and 5 more"``."""
    names = list(names)
    shown = ", ".join(names[:MAX_NAMES])
    others = len(names) - MAX_NAMES
    return f"{shown} and {others} more" if others > 0 else shown


# Reasons why a name leads to no readable file; every other error of a system call
# concerns the system.
_OF_THE_FILE = (
    errno.ENOENT,
    errno.ENOTDIR,
    errno.EISDIR,
    errno.ELOOP,
    errno.ENAMETOOLONG,
    errno.EINVAL,
)
_HDF5_ERRNO = re.compile(r"\berrno = (\d+)")


def system_error_of(error: BaseException | None) -> BaseException | None:
    """Return the error of the system that is this error or its cause; None if the content of a
    file is the cause.

    Examples are too many open files, no memory, no permission, and a device that fails. A reader
    that leaves out damaged files must not leave out files for such a reason.
    """
    while error is not None:
        if isinstance(error, MemoryError):
            return error
        # FFmpeg reports damaged files as I/O errors; those of the file itself are passed
        # on as Python's.
        if isinstance(error, OSError) and not type(error).__module__.startswith("av."):
            found = _HDF5_ERRNO.search(str(error))
            number = int(found[1]) if found else error.errno
            if number and number not in _OF_THE_FILE:
                return error
        error = error.__cause__ or (None if error.__suppress_context__ else error.__context__)
    return None


def reason_of(error: BaseException | None) -> str:
    """Return the reason of a read or write error on one line: ``No space left on device``,
    ``not a text file``.
    """
    if isinstance(error, UnicodeDecodeError):
        return "not a text file"
    text = getattr(error, "strerror", None) or str(error)
    if wrapped := re.search(r"error message = '([^']*)'", text):  # HDF5 embeds it in a longer text
        text = wrapped[1]
    return " ".join((text or type(error).__name__).split())


@functools.cache
def warn_once(text: str) -> None:
    """Log a warning unless this process has logged it before."""
    logging.getLogger("netlib").warning(text)
