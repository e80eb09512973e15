"""The command-line tools, one file per command; tools/common has what they share.

No command imports another.

A command calls ``begin`` before it imports large packages, and runs in console.guarded.
"""

from __future__ import annotations

import contextlib
import importlib
import io
import os
import signal
import sys
import warnings
from collections.abc import Iterator
from types import TracebackType

_is_program = False  # true if a command was started as a program, not imported


def begin(name: str) -> None:
    """Start a command with this ``__name__``.

    If it runs as a program, prepare the process first.
    """
    global _is_program
    if name == "__main__":
        _is_program = True
        sys.excepthook = _say_what_cannot_be_loaded
        if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
            # Ctrl-C during the imports ends it without a traceback
            signal.signal(signal.SIGINT, signal.SIG_DFL)
        _prepare_streams()
        # hide NumPy's warnings unless python -W asks for them; tools report what matters
        if not sys.warnoptions:
            warnings.simplefilter("ignore")
    # must be imported before NumPy, because it selects BLAS kernels
    importlib.import_module("netlib")


def _say_what_cannot_be_loaded(
    kind: type[BaseException], error: BaseException, trace: TracebackType | None
) -> None:
    """Print one line for an import that fails before console.guarded: a missing package, or too
    little memory.
    """
    if not isinstance(error, (ImportError, MemoryError)):
        sys.__excepthook__(kind, error, trace)
        return
    text = " ".join(str(error).split())
    is_memory = (
        isinstance(error, MemoryError)
        or "failed to map" in text
        or "cannot allocate memory" in text.lower()
    )
    what = getattr(error, "name", None) or "the packages"
    print(
        f"not enough memory to load {what}" if is_memory else f"cannot load {what}: {text}",
        file=sys.stderr,
    )


@contextlib.contextmanager
def interruptible() -> Iterator[None]:
    """Context manager: Ctrl-C raises KeyboardInterrupt within it; outside, it ends the
    process of a command.
    """
    if not _is_program or signal.getsignal(signal.SIGINT) is not signal.SIG_DFL:
        yield
        return
    signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, signal.SIG_DFL)


def _prepare_streams() -> None:
    """Open closed standard streams on the null device, and escape characters that the others
    cannot encode.
    """
    # otherwise the next file opened would get the number
    while (null := os.open(os.devnull, os.O_RDWR)) <= 2:
        pass
    os.close(null)
    if sys.stderr is None:  # print(file=None) would write to stdout
        sys.stderr = os.fdopen(2, "w", 1, encoding="utf-8")
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")
