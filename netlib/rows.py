"""Rows of a batch, cut into blocks."""

from __future__ import annotations


def blocks(count: int, size: int) -> list[slice]:
    """``range(count)`` in slices of ``size``, the last one shorter."""
    return [slice(start, min(start + size, count)) for start in range(0, count, size)]
