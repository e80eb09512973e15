"""A file of the documents that is made from the code, and when the one that lies there is still the same."""

from __future__ import annotations

import operator
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]


@dataclass(frozen=True)
class Made:
    """What ``path`` has to hold now. ``same(there, content)`` says whether what lies there is as good."""

    path: Path
    content: bytes
    same: Callable[[bytes, bytes], bool] = operator.eq

    def is_current(self) -> bool:
        """Whether the file is there and holds it."""
        return self.path.is_file() and self.same(self.path.read_bytes(), self.content)
