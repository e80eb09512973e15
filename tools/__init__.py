"""The command-line tools: one file per command, and in tools/common what they share. No command imports another.

A command calls ``begin`` before it imports anything large, and runs in console.guarded.
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

_is_program = False  # is this the process of a command, and not of tests or of somebody who imports one


def begin(name: str) -> None:
    """Begin a command whose ``__name__`` this is. If it is run as a program, its process is prepared first."""
    global _is_program
    if name == "__main__":
        _is_program = True
        if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
            signal.signal(signal.SIGINT, signal.SIG_DFL)  # during the imports, Ctrl-C ends it without a traceback
        _prepare_streams()
        if not sys.warnoptions:  # python -W default shows NumPy's; what matters of them is said in the tool's words
            warnings.simplefilter("ignore")
    importlib.import_module("netlib")  # before NumPy: it chooses BLAS kernels


@contextlib.contextmanager
def interruptible() -> Iterator[None]:
    """Within it, Ctrl-C is a KeyboardInterrupt; in a command's process, before it and after it ends the process."""
    if not _is_program or signal.getsignal(signal.SIGINT) is not signal.SIG_DFL:
        yield
        return
    signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, signal.SIG_DFL)


def _prepare_streams() -> None:
    """Open standard streams that are closed on the null device, and escape what the others cannot encode."""
    while (null := os.open(os.devnull, os.O_RDWR)) <= 2:  # else a file that is opened later takes the number
        pass
    os.close(null)
    if sys.stderr is None:  # print(file=None) would write to stdout
        sys.stderr = os.fdopen(2, "w", 1, encoding="utf-8")
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")
