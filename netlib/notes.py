"""The log: glog's format, in which Caffe's own parsers read it, and notes that are said once in a process."""

from __future__ import annotations

import functools
import logging
import time

log = logging.getLogger("netlib")


class CaffeFormatter(logging.Formatter):
    """``I1121 01:57:02.956642 28053 solver.py:238] Iteration 3 ...``, glog's format, as log parsers expect it."""

    def format(self, record: logging.LogRecord) -> str:
        """The line for one record."""
        stamp = time.strftime("%m%d %H:%M:%S", time.localtime(record.created))
        micro = int(record.created % 1 * 1e6)
        text = record.getMessage()
        letter = record.levelname[0]
        return f"{letter}{stamp}.{micro:06d} {record.process} {record.filename}:{record.lineno}] {text}"


@functools.cache
def once(text: str) -> None:
    """Say it, if it was not said before."""
    log.warning(text)
