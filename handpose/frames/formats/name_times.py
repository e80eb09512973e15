"""Ways to read the times in file names: units, dates, fractions, stamps of a clock, and numbers of frames.

found = reading(["00012_1616799936125", "00013_1616799936158"])      # times 1616799936125, ... ms since 1970
"""

from __future__ import annotations

import itertools
import re
from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

from handpose.frames.formats import dates, time_units
from handpose.frames.formats.time_units import FRAMES, NANO, TICKS

NAMED_UNITS = {"us": "us", "ms": "ms", "ns": "ns", "usec": "us", "msec": "ms", "nsec": "ns"}
SAYS_UNIT = re.compile(r"(?<!\d)(\d{1,18})(us|ms|ns|usec|msec|nsec)(?![A-Za-z])")
FRACTION = re.compile(r"(?<!\d)(\d{1,13})([.,])(\d{1,20})(?!\d)")
PAIR = re.compile(r"(?<!\d)(\d{9,10})([-_])(\d{1,9})(?!\d)")  # seconds since 1970, and a fraction
SAME_MOMENT = 2  # s; maximum difference of two clocks in a name


class Reading(NamedTuple):
    """One way to read the times in names.

    times  one for each name; numbers of frames if ``ticks`` is 0
    ticks  per second
    how    interpretation of the names
    rests  the names without their times
    """

    times: list[int]
    ticks: int
    how: str
    rests: list[str]


def reading(stems: list[str], unit: str | None = None) -> Reading | None:
    """The first reading by which all names, of equal texts, are one sequence; None without one.

    Names of the same moment are a sequence only if there is no other reading: the caller reports them.
    """
    if unit is None:
        readers: tuple[Callable[[list[str]], Iterator[Reading]], ...] = (_named_units, _dates, _fractions, _stamps)
        readings = [*(read(stems) for read in readers), _counts(stems)]
    else:
        readings = [_counts(stems) if unit == FRAMES else _given(stems, unit)]
    first = None
    for found in itertools.chain(*readings):
        if _is_one_sequence(found):
            if len(set(found.times)) == len(stems):
                return found
            first = first or (found if len(set(found.rests)) == 1 else None)
    return first


def _is_one_sequence(found: Reading) -> bool:
    """True if all numbers besides the time are constant or ascend with it, or are a clock that agrees with it."""
    order = sorted(range(len(found.times)), key=lambda i: found.times[i])
    if len({texts(rest) for rest in found.rests}) > 1:
        return False
    columns = zip(*(map(int, re.findall(r"\d+", found.rests[i])) for i in order))
    if all(len(set(column)) == 1 or all(a < b for a, b in itertools.pairwise(column)) for column in columns):
        return True
    return any(
        _agree(found, other) and _is_one_sequence(other._replace(times=found.times))
        for read in (_dates, _stamps)
        for other in read(found.rests)
    )


def _agree(found: Reading, other: Reading) -> bool:
    """True if two clocks run together; of numbers of frames, at most one second passes from one to the next."""
    order = sorted(range(len(found.times)), key=lambda i: found.times[i])
    if not found.ticks:
        pairs = itertools.pairwise(order)
        return all(
            0 <= other.times[b] - other.times[a] <= SAME_MOMENT * other.ticks * (found.times[b] - found.times[a])
            for a, b in pairs
        )
    first = order[0]
    offsets = [
        (other.times[i] - other.times[first]) / other.ticks - (found.times[i] - found.times[first]) / found.ticks
        for i in order
    ]
    return bool(other.ticks) and max(map(abs, offsets)) <= SAME_MOMENT


def _named_units(stems: list[str]) -> Iterator[Reading]:
    """Numbers with their unit."""
    found = [SAYS_UNIT.search(stem) for stem in stems]
    units = {match and NAMED_UNITS[match[2]] for match in found}
    if len(units) == 1 and None not in units:
        matches = [match for match in found if match]
        unit = NAMED_UNITS[matches[0][2]]
        times = [int(match[1]) for match in matches]
        yield Reading(times, TICKS[unit], f"times from the file names, in {unit}", _without(stems, matches))


def _dates(stems: list[str]) -> Iterator[Reading]:
    """Dates and times of day."""
    for found in dates.dates(stems):
        yield Reading(found.times, NANO, "times from the dates in their names", found.rests)


def _fractions(stems: list[str], unit: str | None = None) -> Iterator[Reading]:
    """Numbers with a decimal fraction, and pairs of seconds since 1970 and a fraction; the last in the names first.

    ``unit`` is that of the numbers if it is known.
    """
    for matches in _in_columns(stems, FRACTION):
        whole, fractions = [int(match[1]) for match in matches], [match[3] for match in matches]
        found, how = unit, "as given"
        if found is None:
            found, how = time_units.since_1970(whole), "since 1970"
        if found is None:
            numbers = [float(f"{a}.{b}") for a, b in zip(whole, fractions)]
            found, how = time_units.by_steps(numbers, ("ms", "us", "ns")), "by their steps"
        if found is None and _is_precise(fractions):
            found, how = "s", ""
        if found is not None:
            digits = len(str(NANO // TICKS[found])) - 1  # of the fraction, down to a nanosecond
            rest = [int(fraction[:digits].ljust(digits, "0") or 0) for fraction in fractions]
            times = [a * 10**digits + b for a, b in zip(whole, rest)]
            named = "seconds" if found == "s" else f"{found} {how}"
            yield Reading(times, NANO, f"times from the file names, in {named}", _without(stems, matches))
    for matches in _in_columns(stems, PAIR) if unit is None else ():
        yield from _pair(stems, matches)


def _pair(stems: list[str], matches: list[re.Match[str]]) -> Iterator[Reading]:
    """Seconds since 1970, and ms, us or ns in another number."""
    seconds, fractions = [int(match[1]) for match in matches], [match[3] for match in matches]
    widths, numbers = {len(fraction) for fraction in fractions}, [int(fraction) for fraction in fractions]
    digits = min(widths) if len(widths) == 1 else next(k for k in (3, 6, 9) if max(numbers) < 10**k)
    times = [second * NANO + number * 10 ** (9 - digits) for second, number in zip(seconds, numbers)]
    is_clock = time_units.since_1970(seconds) == "s" and digits in (3, 6, 9)
    if is_clock and time_units.by_steps(times, ("ns",)):
        yield Reading(times, NANO, "times from the file names, in seconds since 1970", _without(stems, matches))


def _is_precise(fractions: list[str]) -> bool:
    """True if these digits are fractions of a second rather than numbers of versions or frames.

    Some have 3 digits. If they differ in length, trailing zeros were left out, so 1.100 is not a time.
    """
    widths = {len(one) for one in fractions}
    padded = any(one.endswith("0") for one in fractions if len(one) > 1)
    return max(widths) >= 3 and not (padded and len(widths) > 1)


def _stamps(stems: list[str]) -> Iterator[Reading]:
    """Whole numbers that are times since 1970, or times of a clock by their steps; the last in the names first."""
    columns = [(matches, [int(match[0]) for match in matches]) for matches in _in_columns(stems, re.compile(r"\d+"))]
    for matches, numbers in columns:
        if unit := time_units.since_1970(numbers):
            how = f"times from the file names, in {unit} since 1970"
            yield Reading(numbers, TICKS[unit], how, _without(stems, matches))
    for matches, numbers in columns:
        stepped = time_units.by_steps(numbers, ("us", "ns")) if len(numbers) > 2 else None
        if unit := stepped or ("ms" if time_units.counts_ms(numbers) else None):
            how = f"times from the file names, in {unit} by their steps"
            yield Reading(numbers, TICKS[unit], how, _without(stems, matches))


def _given(stems: list[str], unit: str) -> Iterator[Reading]:
    """Numbers in a given unit, those with a fraction first, then those that step most."""
    yield from _fractions(stems, unit)
    for found in reversed(list(_counts(stems))):
        yield found._replace(ticks=TICKS[unit], how=f"times from the file names, in {unit} as given")


def _counts(stems: list[str]) -> Iterator[Reading]:
    """Numbers of frames, those with the smallest range first, of equal ones the last; without one, all are number 0."""
    how = "frames in the order of the numbers in their names"
    columns = list(_in_columns(stems, re.compile(r"\d+")))
    if not columns:
        yield Reading([0] * len(stems), 0, how, stems)
    readings = [Reading([int(match[0]) for match in found], 0, how, _without(stems, found)) for found in columns]
    yield from sorted(readings, key=lambda one: (len(set(one.times)) == 1, max(one.times) - min(one.times)))


def _in_columns(stems: list[str], pattern: re.Pattern[str]) -> Iterator[list[re.Match[str]]]:
    """The last match of a pattern in each name, then the last but one, and so on while all names have one."""
    found = [list(pattern.finditer(stem)) for stem in stems]
    if len({len(matches) for matches in found}) == 1:
        yield from (list(column) for column in reversed(list(zip(*found))))


def _without(stems: list[str], matches: Sequence[re.Match[str]]) -> list[str]:
    """The names with a star in place of the matches."""
    return [f"{stem[: match.start()]}*{stem[match.end() :]}" for stem, match in zip(stems, matches)]


def texts(stem: str) -> tuple[str, ...]:
    """The parts of a name between its numbers."""
    return tuple(re.split(r"\d+", stem))
