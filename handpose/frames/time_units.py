"""The units of times in the names of frames and in arrays."""

from __future__ import annotations

from collections.abc import Sequence

TICKS = {"s": 1, "ms": 10**3, "us": 10**6, "ns": 10**9}  # per second, of the units of times
FRAME_UNIT = "frames"  # the unit of numbers that count frames
TIME_UNITS = (*TICKS, FRAME_UNIT)
EPOCH = (946684800, 4102444800)  # s since 1970 of the years 2000 and 2100


def since_1970(numbers: Sequence[float]) -> str | None:
    """The unit in which all numbers are times from 2000 to 2100; None without one."""
    for unit, ticks in TICKS.items():
        if all(EPOCH[0] * ticks <= number < EPOCH[1] * ticks for number in numbers):
            return unit
    return None
