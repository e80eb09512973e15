"""The log: names in it are printable, and its format is glog's, which Caffe's own log parsers read."""

from __future__ import annotations

import logging
import time
from typing import SupportsFloat

from netlib.errors import printable
from netlib.proto.prototxt import Message

log = logging.getLogger("netlib")


def show_printable(record: logging.LogRecord) -> bool:
    """A filter for all records of the log, whoever writes them: no name in an argument can begin a line of its own.

    Numbers stay what they are. A prototxt, given as a Message, has several lines; a name in it is quoted already.
    """
    if isinstance(record.args, tuple) and record.args:
        record.args = tuple(arg if isinstance(arg, (SupportsFloat, Message)) else printable(arg) for arg in record.args)
    else:
        record.msg = printable(record.msg)
    return True


log.addFilter(show_printable)


class CaffeFormatter(logging.Formatter):
    """``I1121 01:57:02.956642 28053 solver.py:238] Iteration 3 ...``, glog's format, as log parsers expect it."""

    def format(self, record: logging.LogRecord) -> str:
        """The line for one record."""
        stamp = time.strftime("%m%d %H:%M:%S", time.localtime(record.created))
        micro = int(record.created % 1 * 1e6)
        text = record.getMessage().rstrip("\n")  # as glog, which ends a line that is not ended
        letter = record.levelname[0]
        return f"{letter}{stamp}.{micro:06d} {record.process} {record.filename}:{record.lineno}] {text}"
