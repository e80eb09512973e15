"""Dates and times of day in file names, in the usual styles.

    20210326-230536.png  2021-03-26T23:05:36.125Z.png  2021.03.26 23h05m36s125.png  20210326230536125.png
    26-03-2021_23.05.36.png  03-26-2021 11.05.36 PM.png  26Mar2021_230536.png  210326_230536_125.png  23-05-36.125.png

A fraction of a second has 3, 6 or 9 digits, or any number after a point.
"""

from __future__ import annotations

import itertools
import re
from collections.abc import Iterator, Sequence
from datetime import datetime, timedelta
from typing import NamedTuple

from handpose.frames.formats import time_units
from handpose.frames.formats.time_units import NANO

DAY_ONE = datetime(2000, 1, 1)
MINUTE, DAY = 60 * NANO, 86400 * NANO
MONTHS = ("jan", "feb", "mar", "apr", "may", "jun", "jul", "aug", "sep", "oct", "nov", "dec")
NUMBER = r"\d\d|\d(?=\D)"
MONTH, YEAR = rf"(?P<name>{'|'.join(MONTHS)})[a-z]*", r"(?P<year>20\d\d)"
DAYS = (  # of which the first that fits all names is taken; of day and month in figures, that with the shortest span
    rf"{YEAR}\D?(?P<month>{NUMBER})\D?(?P<day>{NUMBER})",
    rf"(?P<day>{NUMBER})\D?(?P<month>{NUMBER})\D?{YEAR}",
    rf"(?P<month>{NUMBER})\D?(?P<day>{NUMBER})\D?{YEAR}",
    rf"(?P<day>\d\d?)\D?{MONTH}\D{{0,2}}{YEAR}",
    rf"{MONTH}\D?(?P<day>\d\d?)\D{{0,2}}{YEAR}",
    rf"{YEAR}\D?{MONTH}\D?(?P<day>\d\d?)",
    r"(?P<year2>\d\d)(?P<month>\d\d)(?P<day>\d\d)(?=\D)",
)
TIME = (
    rf"(?P<hour>{NUMBER})\D?(?P<minute>{NUMBER})\D?(?P<second>\d\d|(?<=\D)\d(?!\d))"
    r"(?:(?P<dot>[^\d+]?)(?P<fraction>\d+))?(?P<half>[\s_]?[ap]m(?![a-z]))?"
)
STYLES = [
    re.compile(rf"(?<!\d){style}", re.IGNORECASE)
    for day in DAYS
    for style in (rf"{day}\D{{0,4}}{TIME}", rf"{TIME}\D{{1,4}}{day}(?!\d)")
]
TIME_OF_DAY = re.compile(rf"(?<!\d){TIME}(?!\d)", re.IGNORECASE)
WIDTHS = (3, 6, 9)  # digits of a fraction
SMALL_STEP = 3  # of numbers that count frames
COUNTED = 0.75  # share of small steps that shows a count
MIN_STEP, MAX_STEP = NANO // 250, 2 * NANO  # between frames
USUAL = 0.75  # share of such steps in a recording


class Dated(NamedTuple):
    """Dates in names.

    times  ns since the year 2000, or since midnight, one for each name
    rests  the names without the dates
    has_fraction  whether they have fractions of a second
    """

    times: list[int]
    rests: list[str]
    has_fraction: bool


def dates(stems: Sequence[str]) -> Iterator[Dated]:
    """All ways to read dates and times of day in all of the names, the most likely first."""
    readings = [_read(stems, style, True) for style in STYLES]
    found = [dated for dated in readings if dated is not None and not _is_count(dated)]
    yield from sorted(found, key=lambda dated: max(dated.times) - min(dated.times))
    times_of_day = _read(stems, TIME_OF_DAY, False)
    if times_of_day is not None and _is_time_of_day(times_of_day):
        yield times_of_day


def _read(stems: Sequence[str], style: re.Pattern[str], has_day: bool) -> Dated | None:
    """The dates of one style; None unless all names have one."""
    matches = [style.search(stem) for stem in stems]
    found = [match for match in matches if match is not None]
    if len(found) < len(stems):
        return None
    try:
        whole = [_seconds(match, has_day) * NANO for match in found]
    except ValueError:
        return None
    has_fraction = _are_fractions(found, whole)
    times, rests = [], []
    for stem, match, time in zip(stems, found, whole):
        fraction = match["fraction"] if has_fraction else None
        rest = "" if has_fraction or match["fraction"] is None else f"{match['dot']}{match['fraction']}"
        times.append(time + int((fraction or "")[:9].ljust(9, "0")))
        rests.append(f"{stem[: match.start()]}*{rest}{stem[match.end() :]}")
    if not has_day:  # a recording over midnight
        order = sorted(times)
        gap = next((b for a, b in itertools.pairwise(order) if b - a > DAY // 2), None)
        times = [time + DAY if gap is not None and time < gap else time for time in times]
    return Dated(times, rests, has_fraction)


def _seconds(match: re.Match[str], has_day: bool) -> int:
    """The seconds since DAY_ONE or since midnight. Raises ValueError for no date."""
    part = match.groupdict()
    hour = int(part["hour"])
    if part["half"]:
        if not 1 <= hour <= 12:
            raise ValueError(f"{hour} {part['half']}")
        hour = hour % 12 + (12 if part["half"][-2:].lower() == "pm" else 0)
    clock = timedelta(hours=hour, minutes=int(part["minute"]), seconds=int(part["second"]))
    if hour > 23 or int(part["minute"]) > 59 or int(part["second"]) > 59:
        raise ValueError(f"{clock}")
    if not has_day:
        return int(clock.total_seconds())
    name = part.get("name")
    month = MONTHS.index(name.lower()) + 1 if name else int(part["month"])
    year = int(part.get("year") or 2000 + int(part["year2"]))
    return int((datetime(year, month, int(part["day"])) + clock - DAY_ONE).total_seconds())


def _are_fractions(found: Sequence[re.Match[str]], whole: Sequence[int]) -> bool:
    """True if the digits after the seconds are fractions of a second; otherwise they are other numbers of the name.

    They are fractions after a point. Elsewhere they have a fixed width and are no numbers that count frames; within a
    single second they must also step as the times of a camera do.
    """
    fractions = [match["fraction"] or "" for match in found]
    widths = {len(fraction) for fraction in fractions}
    if "" in fractions:
        return False
    in_order = [number for _, number in sorted((time, int(one)) for time, one in zip(whole, fractions))]
    moments = sorted(whole)
    steps = [b - a for (a, b), (s, t) in zip(itertools.pairwise(in_order), itertools.pairwise(moments)) if s == t]
    are_counted = sum(step <= SMALL_STEP for step in steps) >= COUNTED * max(1, len(steps)) and bool(steps)
    if all(match["dot"] in (".", ",") for match in found):
        return not (are_counted and len(widths) > 1)
    if len(widths) > 1 or not widths <= set(WIDTHS) or are_counted:
        return False
    unit = {3: "ms", 6: "us", 9: "ns"}[widths.pop()]
    increasing = all(b > a for a, b in itertools.pairwise(in_order))
    if len(set(whole)) == 1:
        return len(found) > 2 and time_units.by_steps(in_order, (unit,)) is not None
    return not (increasing and sum(b - a <= SMALL_STEP for a, b in itertools.pairwise(in_order)) >= COUNTED)


def _is_count(found: Dated) -> bool:
    """True for 20210326_000001, 20210326_000002 ...: numbers after a date rather than seconds after midnight."""
    times = sorted(found.times)
    steps = {b - a for a, b in itertools.pairwise(times)}
    return not found.has_fraction and steps == {NANO} and times[0] % DAY < MINUTE


def _is_time_of_day(found: Dated) -> bool:
    """True if a minute, or a second with fractions, ends within these times, and most steps are those of frames.

    Otherwise the digits may be any others, and if they are a time of day, they can be read as seconds.
    """
    times = sorted(found.times)
    usual = sum(MIN_STEP <= b - a <= MAX_STEP for a, b in itertools.pairwise(times))
    unit = NANO if found.has_fraction else MINUTE
    return usual > USUAL * (len(times) - 1) and times[0] // unit != times[-1] // unit
