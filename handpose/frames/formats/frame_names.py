"""The order and the times of depth frames by the names of their files.

    000000033333us.png                      us, ms or ns as named, as ``tools/record.py`` writes
    1616799936125.png 1616799936.125.png    s, ms, us or ns since 1970, by their size, also
                                            with a fraction
    132612735361250000.png                  100 ns since 1601 or the year 1, as Windows has them
    00012_1616799936125.png                 a count and such a time, in any order: the time
    0.033333.png                            s, if the frames are less than a second apart
    0001.png frame_7.png 34512.png          other numbers count frames, one frame period each,
                                            unless a unit is given
    2021-03-26 23h05m36s125.png             of dates only the order is used: one frame period each

The texts between the numbers of a sequence are equal, and so are all numbers except the time and
those that ascend with it.
"""

from __future__ import annotations

import glob
import itertools
import re
from collections import defaultdict
from collections.abc import Iterable, Iterator, Sequence
from decimal import Decimal
from pathlib import PurePath
from statistics import median
from typing import NamedTuple

from handpose.frames.time_units import FRAME_UNIT, TICKS, TIME_UNITS, clock_of
from netlib.errors import DataError, some_of

NANO = TICKS["ns"]
NAMED_UNIT = re.compile(r"(?<!\d)(\d+)([mun]s)(?:ec)?(?![A-Za-z])")
SINCE_1970 = re.compile(r"(?<!\d)(\d{9,19})(?:\.(\d+)|(?<=(?<!\d)\d{10})[_-](\d{6}|\d{9}))?(?!\d)")
DATE = re.compile(
    r"(?<!\d)20\d\d\D?[01]\d\D?[0-3]\d(?:\D{0,4}[0-2]\d\D?[0-5]\d\D?[0-5]\d(?:\.\d+)?)?"
)
FRACTION = re.compile(r"\d+\.\d+")
DIGITS, DECIMAL = re.compile(r"\d+"), re.compile(r"\d+(?:[.,]\d+)?")
SPARSE = 10  # times as many numbers as frames are no count if the names have a date
FRACTION_LENGTHS = (6, 9)  # digits of numbers of us and ns
MIN_TIMES = 3  # minimum number of times that show whether leading zeros are missing


class Reading(NamedTuple):
    """One way to read the times in names.

    times  one for each name, in ns; numbers of frames if ``ticks`` is 0
    ticks  per second; 0 if they count frames
    how    interpretation of the names
    rests  the names without their times
    """

    times: Sequence[int]
    ticks: int
    how: str
    rests: Sequence[str]


def in_order(
    names: Iterable[str], where: str, unit: str | None = None
) -> tuple[list[str], Reading]:
    """The names in the order of time, and their times from the first one on, which ascend.

    Raises DataError for several sequences, and for two frames of the same moment.

    unit  of the times in the names, "frames" if they are numbers; inferred by default
    """
    names = sorted(names)
    groups = groups_of(names)
    found = _reading(names, unit) if len(groups) == 1 else None
    if found is not None:
        return _sorted(names, found, where)
    by_number = _reading(names, FRAME_UNIT) if len(groups) == 1 and unit is None else None
    if by_number is not None and _range(by_number) < SPARSE * len(names):
        raise DataError(
            f"{where}: the times in the names, as in {names[0]}, do not ascend with the frames' numbers; --time-unit "
            "frames takes these alone"
        )
    by_time = _reading(names, "s") if len(groups) == 1 and unit is None else None
    if by_time is not None:
        raise DataError(
            f"{where}: the numbers in the names, as in {names[0]}, may be times of an unknown unit; give --time-unit "
            f"{', '.join(TIME_UNITS)}"
        )
    sequences = sorted(
        (_pattern(part), len(part)) for group in groups.values() for part in _sequences(group, unit)
    )
    shown = some_of(f"{pattern} ({count})" for pattern, count in sequences)
    # a name with depth before the others, of these the longest sequence
    example, _ = min(sequences, key=lambda one: ("depth" not in one[0].lower(), -one[1]))
    raise DataError(
        f"{where}: holds {len(sequences)} sequences: {shown}; name one, as '{where}/{example}'"
    )


def groups_of(names: Iterable[str]) -> dict[tuple[str, ...], list[str]]:
    """The names in groups of equal texts between the numbers."""
    groups: dict[tuple[str, ...], list[str]] = defaultdict(list)
    for name in names:
        path = PurePath(name)
        key = (*DIGITS.split(path.stem), path.suffix.lower())
        groups[key].append(name)
    return groups


def _sorted(names: Sequence[str], found: Reading, where: str) -> tuple[list[str], Reading]:
    times, ticks, how, rests = found
    order = sorted(range(len(names)), key=lambda i: times[i])
    for a, b in itertools.pairwise(order):
        if times[a] == times[b]:
            raise DataError(
                f"{where}: {names[a]} and {names[b]} are frames of the same moment; remove one of them"
            )
    first = times[order[0]]
    if not ticks and (missing := times[order[-1]] - first + 1 - len(names)):
        how += (
            f"; numbers missing between {first} and {times[order[-1]]}: {missing}, which stay gaps in time "
            "(--time-unit if they are times)"
        )
    if ticks and len(names) > 1:
        step = median(times[b] - times[a] for a, b in itertools.pairwise(order))
        how += f": a frame every {1000 * step / ticks:.3g} ms"
    reading = Reading([times[i] - first for i in order], ticks, how, [rests[i] for i in order])
    return [names[i] for i in order], reading


def _reading(names: Sequence[str], unit: str | None) -> Reading | None:
    """The first reading by which all names, of equal texts, are one sequence; None without one.

    Names of the same moment are a sequence only if there is no other reading: the
    caller reports them.
    """
    possible = [
        found
        for found in _readings([PurePath(name).stem for name in names], unit)
        if _is_one_sequence(found, unit == FRAME_UNIT)
    ]
    strict = (found for found in possible if len(set(found.times)) == len(names))
    return next(strict, next((found for found in possible if len(set(found.rests)) == 1), None))


def _is_one_sequence(found: Reading, are_frames: bool) -> bool:
    """True if all numbers besides the time are constant or ascend with it. If the frames' numbers
    are read in place of times, times since 1970 need not.
    """
    order = sorted(range(len(found.times)), key=lambda i: found.times[i])
    columns = zip(*(map(int, DIGITS.findall(found.rests[i])) for i in order))
    changing = [
        column
        for column in columns
        if len(set(column)) > 1 and not (are_frames and clock_of(column))
    ]
    return all(a < b for column in changing for a, b in itertools.pairwise(column))


def _readings(stems: list[str], unit: str | None) -> list[Reading]:
    """The ways to read names of equal texts, the most certain first.

    Of several numbers that step alike, the last one is taken first; of counts, the one with the
    smallest range.
    """

    def in_nanoseconds(matches: list[re.Match[str]], factor: int = NANO) -> list[int]:
        return [int(Decimal(match[0].replace(",", ".")) * factor) for match in matches]

    counted = "frames in the order of the numbers in their names"
    counts = [
        _read(stems, matches, [int(match[0]) for match in matches], 0, counted)
        for matches in _in_columns(stems, DIGITS)
    ]
    counts = counts or [Reading([0] * len(stems), 0, counted, stems)]
    counts.sort(key=lambda one: (len(set(one.times)) == 1, _range(one)))
    if unit == FRAME_UNIT:
        return counts
    if unit is not None:
        factor = NANO // TICKS[unit]
        how = f"times from the file names, in {unit} as given"
        given = [
            _read(stems, matches, in_nanoseconds(matches, factor), NANO, how)
            for matches in _in_columns(stems, DECIMAL)
        ]
        return sorted(given, key=_range, reverse=True)
    # numbers with a fraction, less than a second apart on average
    how = "times from the file names, taken for s (--time-unit if that is wrong)"
    seconds = [
        _read(stems, matches, in_nanoseconds(matches), NANO, how)
        for matches in _in_columns(stems, FRACTION)
    ]
    slow = [one for one in seconds if _range(one) < NANO * len(stems)]
    dense = [one for one in counts if _range(one) < SPARSE * len(stems)]
    return [*_with_units(stems), *_since_1970(stems), *dense, *_dated(stems), *slow, *counts]


def _with_units(stems: list[str]) -> Iterator[Reading]:
    """Numbers followed by a unit, which is the same in all names."""
    for matches in _in_columns(stems, NAMED_UNIT):
        unit = matches[0][2]
        times = [int(match[1]) * (NANO // TICKS[unit]) for match in matches]
        yield _read(stems, matches, times, NANO, f"times from the file names, in {unit}")


def _since_1970(stems: list[str]) -> Iterator[Reading]:
    """Times since 1970, also with a fraction, and those of Windows. Those with the smallest range
    come first, because ticks of a clock may look like such times.
    """
    found: list[Reading] = []
    for matches in _in_columns(stems, SINCE_1970):
        clock = clock_of([int(match[1]) for match in matches])
        if clock is not None:
            # of the fraction, down to a nanosecond
            digits = len(str(NANO // TICKS[clock.unit])) - 1
            times = _with_fractions(matches, digits)
            how = f"times from the file names, {clock}"
            found.append(_read(stems, matches, times, NANO, how))
    yield from sorted(found, key=_range)


def _with_fractions(matches: list[re.Match[str]], digits: int) -> list[int]:
    """The times in matches of SINCE_1970 as whole numbers, with ``digits`` digits of the fraction.

    Fractions of different lengths may be numbers of us or ns without their leading zeros. They are
    read as such if this makes the largest step between at least MIN_TIMES times smaller.
    """
    wholes = [match[1] for match in matches]
    fractions = [(match[2] or match[3] or "")[:digits] for match in matches]
    decimal = [
        int(whole + fraction.ljust(digits, "0")) for whole, fraction in zip(wholes, fractions)
    ]
    length = max(map(len, fractions))
    if length not in FRACTION_LENGTHS or len(matches) < MIN_TIMES:
        return decimal
    padded = [fraction.rjust(length, "0").ljust(digits, "0") for fraction in fractions]
    counted = [int(whole + fraction) for whole, fraction in zip(wholes, padded)]
    return min(decimal, counted, key=_largest_step)


def _largest_step(times: list[int]) -> int:
    return max((b - a for a, b in itertools.pairwise(sorted(times))), default=0)


def _dated(stems: list[str]) -> Iterator[Reading]:
    """Names with several dates, after the same numbers: in the order of all their numbers."""
    matches = [DATE.search(stem) for stem in stems]
    if all(matches) and len({match[0] for match in matches if match}) > 1:
        rows = [tuple(map(int, DIGITS.findall(stem))) for stem in stems]
        ranks = {row: rank for rank, row in enumerate(sorted(set(rows)))}
        rests = [stem[: match.start()] for stem, match in zip(stems, matches) if match]
        how = "frames in the order of the dates in their names, one frame period each"
        yield Reading([ranks[row] for row in rows], 0, how, rests)


def _in_columns(stems: list[str], pattern: re.Pattern[str]) -> Iterator[list[re.Match[str]]]:
    """The last match of a pattern in each name, then the last but one, and so on while all
    names have one.
    """
    found = [list(pattern.finditer(stem)) for stem in stems]
    if len({len(matches) for matches in found}) == 1:
        yield from (list(column) for column in reversed(list(zip(*found))))


def _read(
    stems: list[str], matches: list[re.Match[str]], times: list[int], ticks: int, how: str
) -> Reading:
    """The reading of the times in these matches."""
    rests = [
        f"{stem[: match.start()]}*{stem[match.end() :]}" for stem, match in zip(stems, matches)
    ]
    return Reading(times, ticks, how, rests)


def _range(found: Reading) -> int:
    return max(found.times) - min(found.times)


def _sequences(names: list[str], unit: str | None) -> list[list[str]]:
    """The names of each sequence among names of equal texts: of equal values of one of
    their numbers.
    """
    if _reading(names, unit) is not None:
        return [names]
    columns = [
        column for column in zip(*(DIGITS.findall(name) for name in names)) if len(set(column)) > 1
    ]
    column = min(columns, key=lambda column: len(set(column)))
    return [
        [name for name, own in zip(names, column) if own == value] for value in sorted(set(column))
    ]


def _pattern(names: list[str]) -> str:
    """A pattern of names of equal texts: a star for each number that changes, or
    for the last one.
    """
    path = PurePath(names[0])
    columns = list(zip(*(DIGITS.findall(PurePath(name).stem) for name in names)))
    changes = [len(set(column)) > 1 for column in columns]
    if columns and not any(changes):
        changes[-1] = True
    numbers = ["*" if change else column[0] for change, column in zip(changes, columns)]
    texts = [glob.escape(text) for text in DIGITS.split(path.stem)]
    parts = itertools.zip_longest(texts, numbers, fillvalue="")
    return "".join(itertools.chain(*parts)) + path.suffix
