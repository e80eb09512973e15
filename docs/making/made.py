"""A file of the documents that is made from the code, and when the one that lies there is still the same."""

from __future__ import annotations

import operator
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from netlib.files import atomic
from netlib.files.paths import ROOT


def place_of(document: Path, text: str, offset: int) -> str:
    """``docs/x.md:12``: the line of a document on which the character ``offset`` of its text stands."""
    name = document.relative_to(ROOT) if document.is_relative_to(ROOT) else document.name
    return f"{name}:{text.count(chr(10), 0, offset) + 1}"


@dataclass(frozen=True)
class Made:
    """What ``path`` has to hold now: ``make()`` says it, or raises ValueError if the file names what is not there.

    ``same(there, wanted)`` says whether what lies there is as good.
    """

    path: Path
    make: Callable[[], bytes]
    same: Callable[[bytes, bytes], bool] = operator.eq

    def update(self) -> bool:
        """Write the file if it is not current; whether it was written."""
        wanted = self.make()
        if self._is(wanted):
            return False
        self.path.parent.mkdir(parents=True, exist_ok=True)
        atomic.replace_bytes(self.path, wanted)
        return True

    def is_current(self) -> bool:
        """Whether the file is there and holds it."""
        return self._is(self.make())

    def _is(self, wanted: bytes) -> bool:
        return self.path.is_file() and self.same(self.path.read_bytes(), wanted)
