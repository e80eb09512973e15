"""The unit of time stamps, by their size or by their steps.

A number that is a time since 1970 shows its unit by its size. Other clocks begin anywhere, but a depth camera takes 4
to 250 frames per second, so the steps show the unit.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from statistics import median

TICKS = {"s": 1, "ms": 10**3, "us": 10**6, "ns": 10**9}  # per second
NANO = TICKS["ns"]
FRAMES = "frames"  # the unit of numbers that count frames
EPOCH = (946684800, 4102444800)  # s since 1970 of the years 2000 and 2100
CAMERA_RATES = (4, 250)  # frames per second of depth cameras
OFF_STEP, OFF_CLOCK = 0.2, 0.15  # tolerance of a step, as a share of the period; that of a clock in whole ms
REGULAR_SHARE = 0.75  # minimum share of regular steps
# Steps in whole ms at 6, 9, 15, 24, 30, 45, 60 and 90 frames per second. Others that never vary, such as 10, 16, 40 and
# 100, also occur where every tenth, sixteenth ... frame was kept, so they may count frames.
STEPS_MS = (11, 17, 22, 33, 34, 41, 42, 66, 67, 111, 166, 167)


def since_1970(numbers: Sequence[float]) -> str | None:
    """The unit in which all numbers are times from 2000 to 2100; None without one."""
    for unit, ticks in TICKS.items():
        if all(EPOCH[0] * ticks <= number < EPOCH[1] * ticks for number in numbers):
            return unit
    return None


def by_steps(times: Sequence[float], units: Sequence[str] = ("s", "ms", "us", "ns")) -> str | None:
    """The unit in which the period of these times is that of a camera; None if they step in no regular way.

    Steps are whole multiples of the period where frames are missing. Frames that were picked at random from a long
    recording have large steps, too, but irregular ones.
    """
    steps = _steps(times)
    if not steps or not steps[0]:
        return None
    period = steps[len(steps) // 4]
    regular = sum(abs(step - round(step / period) * period) <= max(OFF_STEP * period, 1e-9) for step in steps)
    if regular < REGULAR_SHARE * len(steps):
        return None
    return _unit_of(period, units)


def counts_ms(numbers: Sequence[int]) -> bool:
    """True if whole numbers are ms of a clock rather than numbers of frames, of which some were left out.

    Most steps are the period, give or take a tick; steps that are all multiples of one number are ms only if it is the
    period of a usual frame rate.
    """
    steps = _steps(numbers)
    if len(steps) < 2 or _unit_of(period := round(median(steps)), ("ms",)) is None:
        return False
    if all(step % period == 0 for step in steps):
        return period in STEPS_MS
    regular = sum(abs(step - period) <= max(1, OFF_CLOCK * period) for step in steps)
    return len(steps) > 3 and regular >= REGULAR_SHARE * len(steps)


def unit_of(times: Sequence[float]) -> str | None:
    """The unit of ascending times by their size or steps; None if they do not show it.

    Irregular steps of at most 1/4 s are seconds: in a smaller unit there would be thousands of frames per second.
    """
    steps = _steps(times)
    return since_1970(times) or by_steps(times) or (_unit_of(median(steps), ("s",)) if steps else "s")


def _steps(times: Sequence[float]) -> list[float]:
    """The steps between the times in their order, sorted."""
    return sorted(b - a for a, b in itertools.pairwise(sorted(times)))


def _unit_of(period: float, units: Sequence[str]) -> str | None:
    """The unit in which a period is that of a camera."""
    slow, quick = CAMERA_RATES
    return next((unit for unit in units if TICKS[unit] / quick <= period <= TICKS[unit] / slow), None)
