"""Notes that are said once in a process, however often there is a reason."""

from __future__ import annotations

import functools
import logging

log = logging.getLogger("netlib")


@functools.cache
def once(text: str) -> None:
    """Say it, if it was not said before."""
    log.warning(text)
