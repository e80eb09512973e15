"""What the tools share: one-line errors, checked numbers, progress, tables, and Caffe's log format."""

from __future__ import annotations

import argparse
import contextlib
import logging
import os
import sys
import threading
import time
from collections.abc import Callable, Sequence
from typing import Any

from netlib.errors import NetlibError, reason_of

DONE, FAILED = 0, 1  # wrong usage is 2, which argparse returns by itself


def guarded(run: Callable[[], int]) -> int:
    """Run a tool; a user's mistake becomes one line on stderr and exit status 1, never a traceback."""
    try:
        return run()
    except NetlibError as error:
        print(" ".join(str(error).split("\n")), file=sys.stderr)
    except UnicodeEncodeError as error:
        print(f"cannot print or write {error.object[error.start : error.end]!r} in the encoding {error.encoding}; "
              "set PYTHONUTF8=1", file=sys.stderr)  # fmt: skip
    except MemoryError:
        print("not enough memory; use a smaller batch_size", file=sys.stderr)
    except BrokenPipeError:  # the reader of our output has gone, as `head` does
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    except OSError as error:
        where = f"{error.filename}: " if error.filename else "standard output: "
        print(f"{where}{reason_of(error)}", file=sys.stderr)
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr)
        return 130
    return FAILED


def positive(text: str) -> int:
    """A command-line number of at least 1."""
    if not text.isdigit() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"expected a whole number of at least 1, found {text!r}")
    return int(text)


def natural(text: str) -> int:
    """A command-line number of at least 0."""
    if not text.isdigit():
        raise argparse.ArgumentTypeError(f"expected a whole number, found {text!r}")
    return int(text)


class CaffeFormatter(logging.Formatter):
    """``I1121 01:57:02.956642 28053 solver.py:238] Iteration 3 ...``, glog's format, as log parsers expect it."""

    def format(self, record: logging.LogRecord) -> str:
        """The line for one record."""
        stamp = time.strftime("%m%d %H:%M:%S", time.localtime(record.created))
        micro = int(record.created % 1 * 1e6)
        text = record.getMessage()
        letter = record.levelname[0]
        return f"{letter}{stamp}.{micro:06d} {threading.get_native_id()} {record.filename}:{record.lineno}] {text}"


class LogFile(logging.FileHandler):
    """A log file. If it cannot be written any more, that is said once, and the training goes on without it."""

    def handleError(self, record: logging.LogRecord) -> None:
        """Say what is wrong, and write no more."""
        error = sys.exc_info()[1]
        logging.getLogger(record.name).removeHandler(self)
        print(f"{self.baseFilename}: cannot write the log any more: {reason_of(error)}", file=sys.stderr)

    def close(self) -> None:
        """Close the file; what could not be written is lost."""
        with contextlib.suppress(OSError):
            super().close()


class BarHandler(logging.StreamHandler):  # type: ignore[type-arg]  # not a generic before Python 3.11
    """Writes log lines above a progress bar."""

    bar: Any = None

    def emit(self, record: logging.LogRecord) -> None:
        """Write one record."""
        if self.bar is None:
            super().emit(record)
        else:
            self.bar.write(self.format(record), file=self.stream)


def progress_bar(total: int, initial: int, unit: str) -> Any:
    """A tqdm bar on stderr if that is a terminal and tqdm is there, else None."""
    if sys.stderr is None or not sys.stderr.isatty():
        return None
    try:
        from tqdm import tqdm
    except ImportError:
        return None
    return tqdm(total=total, initial=initial, unit=unit, dynamic_ncols=True)


def aligned(rows: Sequence[Sequence[str]]) -> str:
    """Rows of cells as a table: the first column to the left, the others to the right."""
    widths = [max(len(cell) for cell in column) for column in zip(*rows)]
    return "\n".join(
        "  ".join(cell.rjust(w) if i else cell.ljust(w) for i, (cell, w) in enumerate(zip(row, widths))) for row in rows
    )


def duration(seconds: float) -> str:
    """``75`` → ``1 min 15 s``."""
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours} h {minutes:02d} min" if hours else f"{minutes} min {rest:02d} s" if minutes else f"{rest} s"
