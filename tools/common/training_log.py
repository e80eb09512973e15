"""The log of a training in glog's format: on standard error above a progress bar, and in a file."""

from __future__ import annotations

import contextlib
import logging
import os
import sys
from collections.abc import Iterable, Iterator
from pathlib import Path

from netlib.distributed.ranks import Ranks
from netlib.errors import NetlibError, reason_of
from netlib.files import locks
from netlib.training.report import CaffeFormatter
from tools.common import outputs
from tools.common.console import notify
from tools.common.progress import ProgressBar
from tools.common.ranks import ended_together

log = logging.getLogger("netlib")


@contextlib.contextmanager
def logged(
    ranks: Ranks, log_file: str | Path | None = None, append: bool = False
) -> Iterator[BarHandler]:
    """Context manager: rank 0 sends netlib's log to stderr and to a file once that has begun; an
    error of one rank ends all. Raises NetlibError, on rank 0.

    append  to an existing file instead of replacing it
    """
    console = BarHandler(sys.stderr)
    handlers: list[logging.Handler] = [console]
    with ended_together(ranks), contextlib.ExitStack() as after:
        if log_file and not ranks.rank:
            console.file = LogFile(log_file, append)
            handlers.append(console.file)
            after.callback(console.file.close)
        after.callback(log.setLevel, log.level)
        after.callback(setattr, log, "propagate", log.propagate)
        log.setLevel(logging.CRITICAL if ranks.rank else logging.INFO)
        log.propagate = False
        for handler in handlers:
            handler.setFormatter(CaffeFormatter())
            log.addHandler(handler)
            after.callback(log.removeHandler, handler)
        yield console


class BarHandler(logging.StreamHandler):  # type: ignore[type-arg]  # not a generic before Python 3.11
    """Writes log lines to a stream, above the progress bar if there is one.

    file  the log file, if any, which receives the same lines
    """

    bar = ProgressBar(0)
    file: LogFile | None = None

    def emit(self, record: logging.LogRecord) -> None:
        """Write one record."""
        try:
            self.print(self.format(record))
        except Exception:
            self.handleError(record)

    def print(self, line: str) -> None:
        """Write a line, above the progress bar if there is one."""
        self.bar.print(line, self.stream)

    def handleError(self, record: logging.LogRecord) -> None:
        """Ignore that standard error cannot be written: the error could only be reported there."""


class LogFile(logging.FileHandler):
    """A log file that buffers lines until ``begin``, so that an earlier failure does not
    replace an older log.

    If writing fails later, one message reports it, and the training continues without the file.
    """

    def __init__(self, path: str | Path, append: bool) -> None:
        super().__init__(path, encoding="utf-8", delay=True)
        self._path = path
        self._append = append
        self._size: int | None = None  # of all whole lines; None for a terminal or device
        self._early: list[logging.LogRecord] = []

    def begin(self, inputs: Iterable[str | Path | None]) -> None:
        """Open the file and write the buffered lines.

        Raises NetlibError if it is one of the inputs, cannot be written, or another process
        is writing it.
        """
        outputs.refuse_inputs(self._path, inputs)
        try:
            Path(self._path).parent.mkdir(parents=True, exist_ok=True)
            self.stream = self._open()
            if Path(self._path).is_file():  # terminals and the null device are not locked
                self._take_lock(self.stream.fileno())
                if not self._append:  # only after the lock is taken
                    self.stream.truncate(0)
                self._size = os.fstat(self.stream.fileno()).st_size
        except OSError as error:
            raise NetlibError(f"{self._path}: cannot write the log: {reason_of(error)}") from error
        while self._early:
            self.emit(self._early.pop(0))

    def _take_lock(self, descriptor: int) -> None:
        """Raise NetlibError, and close the file, if another process is writing it."""
        if not locks.take(descriptor):
            self.close()
            raise NetlibError(
                f"{self._path}: another process is writing this log; wait for it, or choose "
                "another name"
            )

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
        notify(f"{self.baseFilename}: cannot continue the log: {reason_of(error)}")

    def close(self) -> None:
        """Close the file; buffered data that cannot be written is lost."""
        with contextlib.suppress(OSError):
            super().close()
