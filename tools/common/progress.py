"""Long runs: a progress bar on a terminal, and signals that stop them at a safe place."""

from __future__ import annotations

import signal
import sys
import threading
from collections.abc import Callable
from pathlib import Path
from types import FrameType
from typing import Any, TextIO

from netlib import files
from netlib.errors import NetlibError, printable, reason_of
from tools.common.console import DONE, notify


class ProgressBar:
    """A bar on stderr if that is a terminal and tqdm is installed; otherwise nothing is shown.

    with ProgressBar(len(targets)) as progress:
        fit_joints(skeleton, targets, progress=progress)

    total  number of items; with 0 there is no bar
    unit   name of an item, plural
    what   label in front of the bar
    done   number of items done before
    """

    def __init__(self, total: int, unit: str = "frames", what: str = "", done: int = 0) -> None:
        self.total, self.unit, self.what, self.done = total, unit, what, done
        self._bar: Any = None

    def __enter__(self) -> ProgressBar:
        if self.total and sys.stderr is not None and sys.stderr.isatty():
            try:
                from tqdm import tqdm
            except ImportError:
                return self
            self._bar = tqdm(
                total=self.total,
                initial=self.done,
                unit=f" {self.unit}",
                desc=printable(self.what) or None,
                dynamic_ncols=True,
            )
        return self

    def __exit__(self, *error: object) -> None:
        if self._bar is not None:
            self._bar.close()
            self._bar = None

    def __call__(self, count: int) -> None:
        """Advance by ``count`` items."""
        if self._bar is not None:
            self._bar.update(count)

    def reach(self, count: int) -> None:
        """Set the number of items done."""
        if self._bar is not None:
            self._bar.update(count - self._bar.n)

    def note(self, text: str) -> None:
        """Show a text after the bar from the next update on."""
        if self._bar is not None:
            self._bar.set_postfix_str(text, refresh=False)

    def print(self, line: str, stream: TextIO) -> None:
        """Print a line, above the bar if that is visible."""
        if self._bar is None:
            print(line, file=stream, flush=True)
        else:
            self._bar.write(line, file=stream)


class StoppedError(Exception):
    """Raised after a signal requested a stop."""


class Stopper:
    """Context manager: the first Ctrl-C, SIGTERM or SIGHUP, of a terminal that is closed, makes
    ``check`` raise; a second one takes effect at once. A SIGHUP that nohup ignores is ignored.

    The signal itself raises no exception, because that could happen where it is swallowed.
    """

    signum = 0
    _before: dict[signal.Signals, Any]

    def __enter__(self) -> Stopper:
        self._before = {}
        if threading.current_thread() is threading.main_thread():
            stops = [signal.SIGINT, signal.SIGTERM]
            if hasattr(signal, "SIGHUP") and signal.getsignal(signal.SIGHUP) != signal.SIG_IGN:
                stops.append(signal.SIGHUP)
            self._before = {number: signal.signal(number, self._note) for number in stops}
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


def fill_folder(folder: Path, total: int, fill: Callable[[Callable[[int], None]], object]) -> int:
    """Create a folder and fill it, with a progress bar; returns the exit status: 0, 130 or 143.

    Raises NetlibError.

    total  number of missing frames
    fill   called with a function that it must call with the number of new frames wherever
           the run may stop
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
        notify("stopped; whole files are kept, and the next run continues after them")
        return 128 + stopper.signum
    except OSError as error:
        raise NetlibError(f"{folder}: {reason_of(error)}") from None
    return DONE
