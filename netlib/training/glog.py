"""Caffe's log format (glog), which log parsers read, with unprintable characters of names escaped."""

from __future__ import annotations

import logging
import time
from typing import SupportsFloat

from netlib.errors import printable
from netlib.proto.prototxt import Message

log = logging.getLogger("netlib")


def show_printable(record: logging.LogRecord) -> bool:
    """Logging filter that escapes arguments, so that no name can start a new line.

    Numbers are not changed. A Message (a prototxt) may have several lines; its names are quoted already.
    """
    if isinstance(record.args, tuple) and record.args:
        record.args = tuple(arg if isinstance(arg, (SupportsFloat, Message)) else printable(arg) for arg in record.args)
    else:
        record.msg = printable(record.msg)
    return True


log.addFilter(show_printable)


class CaffeFormatter(logging.Formatter):
    """Formats lines as glog does: ``I1121 01:57:02.956642 28053 solver.py:238] Iteration 3 ...``."""

    def format(self, record: logging.LogRecord) -> str:
        """Return the line for one record."""
        stamp = time.strftime("%m%d %H:%M:%S", time.localtime(record.created))
        micro = int(record.created % 1 * 1e6)
        text = record.getMessage().rstrip("\n")  # like glog, which adds a line break only if one is missing
        letter = record.levelname[0]
        return f"{letter}{stamp}.{micro:06d} {record.process} {record.filename}:{record.lineno}] {text}"
