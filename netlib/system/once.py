"""Warnings that are logged once per process."""

from __future__ import annotations

import functools
import logging

log = logging.getLogger("netlib")


@functools.cache
def once(text: str) -> None:
    """Log a warning unless it was logged before."""
    log.warning(text)
