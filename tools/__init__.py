"""The command-line tools: one file per command, and modules that several of them share. No command imports another.

All share arguments, console, progress, stopper and advice. Trainings share training and caffe_log, importers of data
sets preparing. Pictures and plots are in pictures and plots, what a net costs is in costs. The exercises of
docs/exercises and nets as ONNX are packages of their own.

A command calls ``begin`` before it imports anything large, and runs in console.guarded.
"""

from __future__ import annotations

import contextlib
import faulthandler
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
        _keep_stderr_to_ourselves()
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


def _keep_stderr_to_ourselves() -> None:
    """Give sys.stderr a descriptor of its own, and lead descriptor 2, on which C libraries write, to nowhere.

    What cannot be encoded is then written as an escape, on both streams.
    """
    nowhere = os.open(os.devnull, os.O_RDWR)
    while nowhere <= 2:  # a standard stream is closed: no file that is opened later may take its number
        nowhere = os.open(os.devnull, os.O_RDWR)
    encoding = getattr(sys.stderr, "encoding", "utf-8")
    own = os.dup(2)
    os.dup2(nowhere, 2)
    os.close(nowhere)
    sys.stderr = os.fdopen(own, "w", 1, encoding=encoding, errors="backslashreplace")
    sys.__stderr__ = sys.stderr  # type: ignore[misc]  # is Final to others
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="backslashreplace")
    if faulthandler.is_enabled():
        faulthandler.enable(sys.stderr)
