"""Handling of signals that stop a long run at a safe place."""

from __future__ import annotations

import signal
import sys
import threading
from collections.abc import Callable
from pathlib import Path
from types import FrameType
from typing import Any

from netlib import files
from netlib.errors import NetlibError, reason_of
from tools.common.console import DONE, say
from tools.common.progress import ProgressBar


class StoppedError(Exception):
    """Raised after a signal requested a stop."""


class Stopper:
    """Context manager: the first Ctrl-C or SIGTERM makes ``check`` raise; a second one takes effect at once.

    The signal itself raises no exception, because that could happen where it is swallowed.
    """

    signum = 0
    _before: dict[signal.Signals, Any]

    def __enter__(self) -> Stopper:
        self._before = {}
        if threading.current_thread() is threading.main_thread():
            self._before = {number: signal.signal(number, self._note) for number in (signal.SIGINT, signal.SIGTERM)}
        return self

    def __exit__(self, *exception: object) -> None:
        for number, handler in self._before.items():
            signal.signal(number, handler)

    def _note(self, signum: int, frame: FrameType | None) -> None:
        self.signum = signum
        self.__exit__()

    def check(self) -> None:
        """Raise StoppedError if a signal was received."""
        if self.signum:
            raise StoppedError


def fill_folder(folder: Path, kept: str, total: int, fill: Callable[[Callable[[int], None]], object]) -> int:
    """Create and fill a folder, with a progress bar; returns the exit status: 0, 130 or 143. Raises NetlibError.

    kept   what a stopped run keeps, with its verb: "whole files are"
    total  number of missing frames
    fill   called with a function that it must call with the number of new frames wherever the run may stop
    """
    try:
        with Stopper() as stopper:
            files.make_folder(folder)
            with ProgressBar(total) as progress:

                def advance(frames: int) -> None:
                    progress(frames)
                    stopper.check()

                fill(advance)
    except StoppedError:
        say(f"stopped; {kept} kept, and the next run continues after them", file=sys.stderr)
        return 128 + stopper.signum
    except OSError as error:
        raise NetlibError(f"{folder}: {reason_of(error)}") from None
    return DONE
