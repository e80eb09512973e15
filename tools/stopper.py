"""A signal asks a long run to end, and the run ends where that is safe."""

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
from tools.console import DONE, say


class StoppedError(Exception):
    """A signal asked the run to end."""


class Stopper:
    """Within it, the first Ctrl-C or SIGTERM is only noted, and ``check`` raises it; a second one acts at once.

    An exception that the signal itself raised could fall into a place that swallows it.
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
        """Raise StoppedError if a signal came."""
        if self.signum:
            raise StoppedError


def fill_folder(folder: Path, kept: str, fill: Callable[[Callable[[], None]], object]) -> int:
    """Make a folder and have it filled; returns the exit status: 0, 130 or 143. Raises NetlibError.

    kept  what a run that is stopped keeps, with its verb: "whole files are"
    fill  is given a function to be called wherever the run may end
    """
    try:
        with Stopper() as stopper:
            files.make_folder(folder)
            fill(stopper.check)
    except StoppedError:
        say(f"stopped; {kept} kept, and the next run goes on after them", file=sys.stderr)
        return 128 + stopper.signum
    except OSError as error:
        raise NetlibError(f"{folder}: {reason_of(error)}") from None
    return DONE
