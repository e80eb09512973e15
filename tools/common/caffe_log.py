"""Caffe's log: glog's lines, on stderr above a progress bar and in a file."""

from __future__ import annotations

import contextlib
import logging
import sys
from collections.abc import Iterable, Iterator
from pathlib import Path

from netlib.errors import NetlibError, reason_of
from netlib.files import locks
from netlib.training.glog import CaffeFormatter
from tools.common import outputs
from tools.common.console import say
from tools.common.progress import ProgressBar

log = logging.getLogger("netlib")


class BarHandler(logging.StreamHandler):  # type: ignore[type-arg]  # not a generic before Python 3.11
    """Writes log lines to a stream, above the progress bar if there is one."""

    bar: ProgressBar | None = None
    file: LogFile | None = None  # which says the same

    def emit(self, record: logging.LogRecord) -> None:
        """Write one record."""
        if self.bar is None:
            super().emit(record)
        else:
            self.bar.print(self.format(record), self.stream)


class LogFile(logging.FileHandler):
    """A log file, which keeps its lines in memory until ``begin``: what fails before that leaves an older log alone.

    When it cannot be written any more, one message says so, and the training goes on without it.
    """

    def __init__(self, path: str | Path, append: bool) -> None:
        super().__init__(path, encoding="utf-8", delay=True)
        self._path, self._append = path, append
        self._early: list[logging.LogRecord] = []

    def begin(self, inputs: Iterable[str | Path | None]) -> None:
        """Open the file, and write the lines that were kept.

        Raises NetlibError if it is one of the inputs, cannot be written, or another process is writing it.
        """
        outputs.refuse_inputs(self._path, inputs)
        try:
            Path(self._path).parent.mkdir(parents=True, exist_ok=True)
            self.stream = self._open()
            if Path(self._path).is_file():  # a terminal or the null device is for everybody
                if locks.take(self.stream.fileno()) is False:
                    self.close()
                    raise NetlibError(
                        f"{self._path}: another process is writing this log; wait for it, or choose another name"
                    )
                if not self._append:  # only now, when it is nobody else's
                    self.stream.truncate(0)
        except OSError as error:
            raise NetlibError(f"{self._path}: cannot write the log: {reason_of(error)}") from error
        while self._early:
            self.emit(self._early.pop(0))

    def emit(self, record: logging.LogRecord) -> None:
        """Write one record, or keep it."""
        if self.stream is None:
            self._early.append(record)
        else:
            super().emit(record)

    def handleError(self, record: logging.LogRecord) -> None:
        """Say what is wrong, and write no more."""
        error = sys.exc_info()[1]
        self._early.clear()
        logging.getLogger(record.name).removeHandler(self)
        say(f"{self.baseFilename}: cannot write the log any more: {reason_of(error)}", file=sys.stderr)

    def close(self) -> None:
        """Close the file; what could not be written is lost."""
        with contextlib.suppress(OSError):
            super().close()


@contextlib.contextmanager
def log_to(path: str | Path | None, append: bool = False) -> Iterator[BarHandler]:
    """Within it, what netlib logs goes to stderr, and if ``path`` names a file to it, once that has begun.

    ``append`` to what the file holds, instead of replacing it.
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
