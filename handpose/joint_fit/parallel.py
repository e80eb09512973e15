"""Independent work, on the threads of the engine in use (one after the other on the plain engine)."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from functools import partial
from typing import TypeVar

from netlib import engine as engines

T = TypeVar("T")


def for_each(items: Iterable[T], job: Callable[[T], None]) -> None:
    """Do the job for every item, in any order."""
    engines.get().run([partial(job, item) for item in items])
