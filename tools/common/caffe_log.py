"""Caffe's log in glog's format, on stderr above a progress bar and in a file."""

from __future__ import annotations

import contextlib
import logging
import os
import sys
from collections.abc import Iterable, Iterator
from pathlib import Path

from netlib.errors import NetlibError, reason_of
from netlib.files import locks
from netlib.training.report import CaffeFormatter
from tools.common import outputs
from tools.common.console import say
from tools.common.progress import ProgressBar

log = logging.getLogger("netlib")


class BarHandler(logging.StreamHandler):  # type: ignore[type-arg]  # not a generic before Python 3.11
    """Writes log lines to a stream, above the progress bar if there is one."""

    bar: ProgressBar | None = None
    file: LogFile | None = None  # receives the same lines

    def emit(self, record: logging.LogRecord) -> None:
        """Write one record."""
        if self.bar is None:
            super().emit(record)
        else:
            self.bar.print(self.format(record), self.stream)

    def handleError(self, record: logging.LogRecord) -> None:
        """Ignore that standard error cannot be written: the error could only be reported there."""


class LogFile(logging.FileHandler):
    """A log file that buffers lines until ``begin``, so that an earlier failure does not replace an older log.

    If writing fails later, one message reports it, and the training continues without the file.
    """

    def __init__(self, path: str | Path, append: bool) -> None:
        super().__init__(path, encoding="utf-8", delay=True)
        self._path, self._append = path, append
        self._size: int | None = None  # of all whole lines; None for a terminal or device
        self._early: list[logging.LogRecord] = []

    def begin(self, inputs: Iterable[str | Path | None]) -> None:
        """Open the file and write the buffered lines.

        Raises NetlibError if it is one of the inputs, cannot be written, or another process is writing it.
        """
        outputs.refuse_inputs(self._path, inputs)
        try:
            Path(self._path).parent.mkdir(parents=True, exist_ok=True)
            self.stream = self._open()
            if Path(self._path).is_file():  # terminals and the null device are not locked
                if locks.take(self.stream.fileno()) is False:
                    self.close()
                    raise NetlibError(f"{self._path}: another process is writing this log; wait for it, or choose "
                                      "another name")
                if not self._append:  # only after the lock is taken
                    self.stream.truncate(0)
                self._size = os.fstat(self.stream.fileno()).st_size
        except OSError as error:
            raise NetlibError(f"{self._path}: cannot write the log: {reason_of(error)}") from error
        while self._early:
            self.emit(self._early.pop(0))

    def emit(self, record: logging.LogRecord) -> None:
        """Write or buffer one record."""
        if self.stream is None:
            self._early.append(record)
        else:
            super().emit(record)
            if self.stream is not None and self._size is not None:
                self._size = os.fstat(self.stream.fileno()).st_size

    def handleError(self, record: logging.LogRecord) -> None:
        """Report the error and stop writing; the file keeps its whole lines."""
        error = sys.exc_info()[1]
        self._early.clear()
        logging.getLogger(record.name).removeHandler(self)
        if self.stream is not None and self._size is not None:
            with contextlib.suppress(OSError):
                descriptor = os.dup(self.stream.fileno())
                self.close()
                os.ftruncate(descriptor, self._size)
                os.close(descriptor)
            self._size = None
        say(f"{self.baseFilename}: cannot continue the log: {reason_of(error)}", file=sys.stderr)

    def close(self) -> None:
        """Close the file; buffered data that cannot be written is lost."""
        with contextlib.suppress(OSError):
            super().close()


@contextlib.contextmanager
def log_to(path: str | Path | None, append: bool = False) -> Iterator[BarHandler]:
    """Context manager that sends netlib's log to stderr and, if ``path`` is given, to a file once that has begun.

    ``append`` to an existing file instead of replacing it.
    """
    console = BarHandler(sys.stderr)
    handlers: list[logging.Handler] = [console]
    if path:
        console.file = LogFile(path, append)
        handlers.append(console.file)
    before = log.level, log.propagate
    log.setLevel(logging.INFO)
    log.propagate = False
    for handler in handlers:
        handler.setFormatter(CaffeFormatter())
        log.addHandler(handler)
    try:
        yield console
    finally:
        for handler in handlers:
            log.removeHandler(handler)
            if handler is not console:
                handler.close()
        log.setLevel(before[0])
        log.propagate = before[1]
