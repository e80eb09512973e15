"""The units of times in the names of frames and in arrays."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

# per second, of the units of times; Windows, and so HoloLens and Kinect 2, counts steps of 100 ns
TICKS = {"s": 1, "ms": 10**3, "us": 10**6, "100ns": 10**7, "ns": 10**9}
FRAME_UNIT = "frames"  # the unit of numbers that count frames
TIME_UNITS = (*TICKS, FRAME_UNIT)
EPOCH = (946684800, 4102444800)  # s since 1970 of the years 2000 and 2100


class Clock(NamedTuple):
    """A clock that counts from the beginning of a year.

    seconds  from then to 1970
    """

    unit: str
    year: int
    seconds: int = 0

    def __str__(self) -> str:
        return f"in {self.unit} since {self.year}"


# no number is a time from 2000 to 2100 of two of them
CLOCKS = (
    *(Clock(unit, 1970) for unit in TICKS),
    Clock("100ns", 1601, 11_644_473_600),  # FILETIME
    Clock("100ns", 1, 62_135_596_800),  # .NET
)


def clock_of(numbers: Sequence[float]) -> Clock | None:
    """The clock by which all numbers are times from 2000 to 2100; None without one."""
    for clock in CLOCKS:
        ticks = TICKS[clock.unit]
        first, end = ((seconds + clock.seconds) * ticks for seconds in EPOCH)
        if all(first <= number < end for number in numbers):
            return clock
    return None
