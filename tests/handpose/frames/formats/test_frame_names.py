"""handpose/frames/formats/frame_names.py"""

from __future__ import annotations

import itertools
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from handpose.frames.formats.frame_names import in_order
from netlib.errors import DataError
from tests.support.bad_input import bad_inputs, in_table
from tests.support.tables import lines_of

HERE = Path(__file__).parent


@pytest.mark.parametrize("row", lines_of(HERE / "names_of_frames.txt"), ids=lambda row: row[0])
def test_file_names_give_the_order_and_the_times(row: list[str]) -> None:
    """Numbers, and times with a known unit, relative to the first frame."""
    names, times, unit, how, given = row if len(row) == 5 else (*row, None)
    ordered, found = in_order(names.split(), "here", given)
    assert found.times == [int(time) for time in times.split()]
    assert found.ticks == {"frames": 0, "ns": 10**9}[unit]
    assert how in found.how
    assert sorted(ordered) == sorted(names.split())


@bad_inputs(DataError, in_table(HERE / "ambiguous_names.txt", "here: "))
def test_ambiguous_and_invalid_names_are_rejected(given: str, rejected: Any) -> None:
    """The error gives the reason."""
    with rejected:
        in_order(given.split(), "here")


@given(st.sets(st.integers(0, 10**12), min_size=1, max_size=20), st.integers(0, 15))
def test_any_numbers(numbers: set[int], width: int) -> None:
    """Numbers, with and without leading zeros, are in order, and gaps are kept."""
    _, found = in_order([f"f{number:0{width}}.png" for number in numbers], "here")
    first = min(numbers)
    assert found.times == sorted(number - first for number in numbers)


@given(st.lists(st.text(min_size=1, max_size=8), min_size=1, max_size=6))
def test_any_names(names: list[str]) -> None:
    """Any names are either put in a strict order, or raise a DataError."""
    try:
        _, found = in_order({f"{name.replace('/', '')}.png" for name in names}, "here")
    except DataError:
        return
    assert all(a < b for a, b in itertools.pairwise(found.times))
