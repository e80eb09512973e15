"""handpose/frames/formats/time_units.py: the units of clocks, and numbers that are not times."""

from __future__ import annotations

import numpy as np
import pytest

from handpose.frames.formats.time_units import by_steps, counts_ms, since_1970, unit_of

CLOCK = np.arange(12) / 30 + 51.234  # s


@pytest.mark.parametrize(("unit", "ticks"), [("s", 1), ("ms", 10**3), ("us", 10**6), ("ns", 10**9)])
def test_units(unit: str, ticks: int) -> None:
    """Times since 1970 and steps of 1/30 s show their unit."""
    assert since_1970([1_700_000_000 * ticks, 1_700_000_001 * ticks]) == unit
    assert by_steps((CLOCK * ticks).tolist()) == unit
    for start in (0, 1_700_000_000):
        assert unit_of((ticks * (CLOCK + start)).tolist()) == unit


def test_what_shows_no_unit() -> None:
    """Irregular steps and steps of no camera."""
    for times in ([0.0, 7.0, 11.0, 40.0, 99.0], [0.0, 1.0, 2.0], [0.0, 0.6, 1.2], [0.0, 0.0]):
        assert by_steps(times) is None and unit_of(times) is None
    assert since_1970([1_700_000_000, 1_700_000_000_000]) is None


def test_short_irregular_steps_are_seconds() -> None:
    """In a smaller unit there would be thousands of frames per second."""
    times = [0.0, 0.04, 0.1, 0.19, 0.31, 0.46]
    assert by_steps(times) is None and unit_of(times) == "s" and unit_of([5.0]) == "s"


def test_a_frame_that_is_missing() -> None:
    """Steps over missing frames are multiples of the period."""
    assert by_steps([0, 33, 67, 167, 200, 233], ("ms",)) == "ms"


@pytest.mark.parametrize("rate", [6, 9, 15, 24, 30, 45, 60, 90])
def test_ms_of_a_clock(rate: int) -> None:
    """Rounded or cut times of a usual rate count ms, also with a frame missing and with jitter."""
    times = np.delete(51234 + 1000 * np.arange(16) / rate, 5)
    jitter = times + np.random.default_rng(0).integers(-1, 2, len(times))
    for numbers in (times.astype(int), np.rint(times).astype(int), np.rint(jitter).astype(int)):
        assert counts_ms(numbers.tolist())
    step = round(1000 / rate)
    assert counts_ms([34512 + step * i for i in range(3)])


@pytest.mark.parametrize("step", [1, 2, 3, 5, 10, 16, 18, 20, 25, 32, 50, 60, 64, 100, 128, 200, 1000])
def test_every_nth_frame_is_no_clock(step: int) -> None:
    """Numbers of every n-th frame are no ms, and neither are numbers picked at random."""
    assert not counts_ms([7 + step * i for i in range(12)])


def test_frames_picked_at_random() -> None:
    """Few of the sets of numbers that were picked at random look like the ms of a clock."""
    rng = np.random.default_rng(0)
    picks = [rng.choice(500, 8, replace=False).tolist() for _ in range(500)]
    assert sum(map(counts_ms, picks)) <= 5
