"""handpose/frames/formats/dates.py: every usual style of dates, over seconds, minutes, noon and midnight."""

from __future__ import annotations

import re
from collections.abc import Callable
from datetime import datetime, timedelta

import pytest

from handpose.frames.formats.dates import dates
from handpose.frames.formats.frame_names import in_order
from handpose.frames.formats.name_times import reading

NANO = 10**9
STEP = timedelta(microseconds=33333)
STARTS = (
    datetime(2025, 11, 3, 9, 15, 42, 200000),
    datetime(2025, 11, 3, 9, 15, 59, 900000),
    datetime(2025, 11, 3, 11, 59, 59, 900000),
    datetime(2025, 12, 31, 23, 59, 59, 900000),
)
STYLES: dict[str, str] = {  # strftime's, where %f is us and %L ms
    "compact": "%Y%m%d%H%M%S%L",
    "iso": "%Y-%m-%dT%H:%M:%S.%f",
    "iso basic with Z": "%Y%m%dT%H%M%S.%LZ",
    "iso with an offset": "%Y-%m-%dT%H-%M-%S.%L+0100",
    "iso with a negative offset": "%Y%m%d_%H%M%S.%L-0500",
    "underscores": "depth_%Y_%m_%d_%H_%M_%S_%f",
    "points": "%Y.%m.%d-%H.%M.%S.%L_z",
    "letters": "%Y-%m-%d_%Hh%Mm%Ss%L",
    "chinese": "%Y年%m月%d日%H时%M分%S秒%L",
    "day first": "%d-%m-%Y %H.%M.%S,%L",
    "month first": "%m-%d-%Y_%H-%M-%S-%L",
    "day first, compact": "%d%m%Y_%H%M%S_%L",
    "two digits of the year": "%y%m%d_%H%M%S_%L",
    "name of the month": "%d%b%Y_%H%M%S.%L",
    "name of the month first": "%B-%d-%Y_%H-%M-%S.%L",
    "name of the month in the middle": "%Y-%b-%d-%H-%M-%S-%L",
    "time first": "%H-%M-%S.%L_%d.%m.%Y",
    "twelve hours": "%Y-%m-%d at %I.%M.%S.%L %p",
    "time of day": "depth-%H-%M-%S-%L",
    "time of day, compact": "%H%M%S.%L",
    "time of day, one number": "%H%M%S%L",
    "hundredths": "%Y%m%d_%H%M%S.%C",
    "count first": "%N_%Y%m%d_%H%M%S_%L",
    "count last": "%Y%m%d_%H%M%S_%L_%N",
    "count and us": "%Y%m%d-%H%M%S-%f-z%N",
}


def named(style: str, moment: datetime, number: int) -> str:
    """The name of a frame."""
    style = style.replace("%L", f"{moment.microsecond // 1000:03}").replace("%C", f"{moment.microsecond // 10000:02}")
    parts = re.split("([^!-~ ])", style.replace("%N", f"{number:05}"))  # strftime depends on the locale for others
    return "".join(moment.strftime(part) if part.isascii() else part for part in parts)


@pytest.mark.parametrize("count", [4, 40])
@pytest.mark.parametrize("start", STARTS, ids=str)
@pytest.mark.parametrize("style", STYLES)
def test_every_style(style: str, start: datetime, count: int) -> None:
    """The times have the steps of the frames, to the resolution of the names."""
    names = [named(STYLES[style], start + i * STEP, i) + ".png" for i in range(count)]
    found = in_order(names, "here")
    assert list(found.names) == names and found.ticks
    off = [time / found.ticks - i * STEP.total_seconds() for i, time in enumerate(found.times)]
    assert max(map(abs, off)) < (0.011 if "%C" in STYLES[style] else 0.0011)


@pytest.mark.parametrize(
    "name",
    [
        lambda i: f"20251103_091542_{i:03}",
        lambda i: f"20251103_091542_{i:06}",
        lambda i: f"20251103-0915{42 + i // 30}-{i:06}",
        lambda i: f"{i:05}_20251103_0915{42 + i // 30}",
        lambda i: f"20251103_091542_{5 * i + 7}",
        lambda i: f"IMG_20251103_{i + 1:06}",
        lambda i: f"20251103{i:06}",
        lambda i: f"01_02_{i:02}",
        lambda i: f"{i:06}",
        lambda i: f"{100 * i:06}",
        lambda i: f"{i:09}",
    ],
)
def test_numbers_after_a_date(name: Callable[[int], str]) -> None:
    """Numbers of frames are no fractions of a second, and numbers of two digits no times of day."""
    found = in_order([f"{name(i)}.png" for i in range(58)], "here")
    assert found.ticks == 0 and "numbers" in found.interpretation
    assert [b - a for a, b in zip(found.times, found.times[1:])] == [found.times[1]] * 57


def test_the_day_and_the_month() -> None:
    """Of day and month in figures the order with the shorter recording is taken."""
    day_first, month_first = (
        ["31-03-2021_235959.png", "01-04-2021_000000.png"],
        ["03-31-2021_235959", "04-01-2021_000000"],
    )
    assert in_order(day_first, "here").times == (0, NANO)
    found = reading(month_first)
    assert found is not None and found.times[1] - found.times[0] == NANO


@pytest.mark.parametrize(
    "stem", ["20219931-230536", "20210326-246536", "2021-02-30 23.05.36", "2021-03-26 13.05.36 PM"]
)
def test_no_dates(stem: str) -> None:
    """Days and times that do not exist are numbers."""
    assert not [found for found in dates([stem, stem.replace("36", "37")]) if len(set(found.times)) > 1]
