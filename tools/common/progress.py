"""Progress bar on a terminal; no output elsewhere."""

from __future__ import annotations

import sys
from typing import Any, TextIO

from netlib.errors import printable


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
            self._bar = tqdm(total=self.total, initial=self.done, unit=f" {self.unit}",
                             desc=printable(self.what) or None, dynamic_ncols=True)
        return self

    def __exit__(self, *error: object) -> None:
        if self._bar is not None:
            self._bar.close()
            self._bar = None

    @property
    def is_shown(self) -> bool:
        """Whether a bar is visible."""
        return self._bar is not None

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
        """Print a line above the bar."""
        if self._bar is not None:
            self._bar.write(line, file=stream)
        else:
            print(line, file=stream, flush=True)
