"""netlib/system/memory.py: blocks."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from netlib.system.memory import blocks


@given(st.integers(0, 300), st.integers(1, 40))
def test_blocks_cut_a_range(count: int, size: int) -> None:
    """The blocks cover the range in order, in pieces of at most ``size``."""
    pieces = [list(range(count))[rows] for rows in blocks(count, size)]
    assert [i for piece in pieces for i in piece] == list(range(count))
    assert all(0 < len(piece) <= size for piece in pieces)
