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
from tools.common.console import DONE, say
from tools.common.progress import ProgressBar


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


def fill_folder(folder: Path, kept: str, total: int, fill: Callable[[Callable[[int], None]], object]) -> int:
    """Make a folder and have it filled, with a bar; returns the exit status: 0, 130 or 143. Raises NetlibError.

    kept   what a run that is stopped keeps, with its verb: "whole files are"
    total  frames that are missing
    fill   is given a function to be called, with how many more are done, wherever the run may end
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
        say(f"stopped; {kept} kept, and the next run goes on after them", file=sys.stderr)
        return 128 + stopper.signum
    except OSError as error:
        raise NetlibError(f"{folder}: {reason_of(error)}") from None
    return DONE
