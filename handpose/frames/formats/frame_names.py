"""The order and times of frames by their names: numbers, time stamps, and how to distinguish them.

    0001.png frame_7.png                      numbers; one frame period each
    20210326-230536_110.png                   a sequence that began then, and a number in it
    20210326-230536.png 20210326_230537.png   dates; with 3, 6 or 9 more digits, fractions of a second
    1616799936.125.png 0.033.png              seconds with a fraction; with 13 digits, ms since 1970 with one
    v1.1.png v1.2.png                         numbers: seconds that do not count from 1970 have 3 digits of fraction
    1616799936125.png                         s, ms, us or ns since 1970, by their size
    790154000_depth.png 790187333_depth.png   us or ns since the camera started, by their steps
    000000033333us.png                        us, ms or ns as named, as ``tools/record.py`` writes

All names of a sequence are equal except for the number or stamp.
"""

from __future__ import annotations

import itertools
import re
from collections import defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from datetime import datetime
from pathlib import PurePath
from statistics import median

from netlib.errors import DataError

UNITS = {"us": 10**6, "ms": 10**3, "ns": 10**9}
SAYS_UNIT = re.compile(r"(\D*)(\d{1,18})(us|ms|ns)")
FRACTION = re.compile(r"(.*?)(?<!\d)(\d{1,13})\.(\d{1,20})")
DATE = re.compile(r"(\D*)(20\d\d)[-_.]?(\d\d)[-_.]?(\d\d)[-_T. ]?(\d\d)[-_.h]?(\d\d)[-_.m]?(\d\d)(?:[-_.]?(\d+))?(\D*)")
NANO = 10**9
DAY_ONE = datetime(2000, 1, 1)
EPOCH = (946684800, 4102444800)  # s since 1970 of the years 2000 and 2100
CAMERA_RATES = (4, 250)  # frames per second of depth cameras
OFF_STEP = 0.2  # tolerance of a step
REGULAR_SHARE = 0.75  # range of the steps between frames
MAX_DIGITS = 18  # maximum digits of a frame number
MAX_SHOWN = 6  # maximum number of sequences in a message


@dataclass(frozen=True)
class NamedFrames:
    """The frames of one sequence, in order.

    names   of the files
    times   of each, in ticks from the first frame on; ascend
    ticks   per second; 0 if they count frames
    interpretation  of the names
    """

    names: tuple[str, ...]
    times: tuple[int, ...]
    ticks: int
    interpretation: str


def in_order(names: Iterable[str], where: str) -> NamedFrames:
    """The frames with these names. Raises DataError for several sequences, and for two frames of the same moment."""
    names = sorted(names)
    stems = [PurePath(name).stem for name in names]
    kinds = {(_texts(stem), PurePath(name).suffix.lower()) for stem, name in zip(stems, names)}
    if len(kinds) == 1:
        for read in (_said_units, _dates, _fractions):
            if (found := read(stems)) is not None:
                return _sorted(names, *found, where)
    return _sorted(names, *_numbers(names, stems, where), where)


def _sorted(names: Sequence[str], times: Sequence[int], ticks: int, interpretation: str, where: str) -> NamedFrames:
    order = sorted(range(len(names)), key=lambda i: times[i])
    for a, b in itertools.pairwise(order):
        if times[a] == times[b]:
            raise DataError(f"{where}: {names[a]} and {names[b]} are frames of the same moment; remove one of them")
    first = times[order[0]]
    if not ticks and (missing := times[order[-1]] - first + 1 - len(names)):
        interpretation += (
            f"; numbers missing between {first} and {times[order[-1]]}: {missing}, which stay gaps in time"
        )
    if ticks and len(names) > 1:
        step = median(times[b] - times[a] for a, b in itertools.pairwise(order))
        interpretation += f": a frame every {1000 * step / ticks:.3g} ms"
    return NamedFrames(tuple(names[i] for i in order), tuple(times[i] - first for i in order), ticks, interpretation)


Found = tuple[list[int], int, str]  # times, ticks, interpretation


def _said_units(stems: list[str]) -> Found | None:
    found = [SAYS_UNIT.fullmatch(stem) for stem in stems]
    units = {match and (match[1], match[3]) for match in found}
    if len(units) > 1 or None in units:
        return None
    unit = next(match[3] for match in found if match)
    return [int(match[2]) for match in found if match], UNITS[unit], f"times from the file names, in {unit}"


def _dates(stems: list[str]) -> Found | None:
    """Dates that differ, or dates with fractions; digits after a few equal dates are a number, not a fraction."""
    found = [DATE.fullmatch(stem) for stem in stems]
    fractions = [match[8] or "" for match in found if match]
    if len(fractions) < len(stems) or len({(match[1], match[9]) for match in found if match}) > 1:
        return None
    try:
        dates = [datetime.strptime("".join(match.groups()[1:7]), "%Y%m%d%H%M%S") for match in found if match]
    except ValueError:
        return None
    width = len(fractions[0])
    if len(set(dates)) == 1 or {len(one) for one in fractions} != {width} or width not in (0, 3, 6, 9):
        return None
    times = [
        int((date - DAY_ONE).total_seconds()) * NANO + int(one.ljust(9, "0")) for date, one in zip(dates, fractions)
    ]
    return times, NANO, "times from the dates in their names"


def _fractions(stems: list[str]) -> Found | None:
    found = [FRACTION.fullmatch(stem) for stem in stems]
    if len({match and match[1] for match in found}) > 1 or None in found:
        return None
    whole = [int(match[2]) for match in found if match]
    fractions = [match[3] for match in found if match]
    milli, seconds = (all(EPOCH[0] * k <= number < EPOCH[1] * k for number in whole) for k in (1000, 1))
    if not (milli or seconds or _is_precise(fractions)):
        return None
    digits = 6 if milli else 9  # maximum digits of the fraction, down to a nanosecond
    rest = [int(fraction[:digits].ljust(digits, "0")) for fraction in fractions]
    times = [a * 10**digits + b for a, b in zip(whole, rest)]
    return times, NANO, f"times from the file names, in {'ms since 1970' if milli else 'seconds'}"


def _is_precise(fractions: list[str]) -> bool:
    """True if these digits are fractions of a second rather than numbers of versions or frames.

    Some have 3 digits. If they differ in length, trailing zeros were left out, so 1.100 is not a time.
    """
    widths = {len(one) for one in fractions}
    padded = any(one.endswith("0") for one in fractions if len(one) > 1)
    return max(widths) >= 3 and not (padded and len(widths) > 1)


def _numbers(names: list[str], stems: list[str], where: str) -> Found:
    """The number in each name, which may be a time since 1970."""
    sequences: dict[str, list[int]] = defaultdict(list)
    columns = _columns(stems)
    for name, stem in zip(names, stems):
        runs = list(re.finditer(r"\d+", stem))
        if not runs:
            sequences[name].append(0)
            continue
        run = runs[columns[_texts(stem)]]
        if len(run[0].lstrip("0")) > MAX_DIGITS + 1:
            raise DataError(f"{where}: {name}: a number of {len(run[0])} digits; expected a frame's number or time")
        sequences[f"{stem[: run.start()]}*{stem[run.end() :]}{PurePath(name).suffix}"].append(int(run[0]))
    if len(sequences) > 1:
        patterns = [f"{pattern} ({len(numbers)})" for pattern, numbers in sorted(sequences.items())]
        more = f" and {len(patterns) - MAX_SHOWN} more" if len(patterns) > MAX_SHOWN else ""
        raise DataError(f"{where}: holds {len(patterns)} sequences: {', '.join(patterns[:MAX_SHOWN])}{more}; name one, "
                        f"as '{where}/{min(sequences)}'")  # fmt: skip
    numbers = next(iter(sequences.values()))
    for unit, ticks in (("s", 1), *((unit, UNITS[unit]) for unit in ("ms", "us", "ns"))):
        if all(EPOCH[0] * ticks <= number < EPOCH[1] * ticks for number in numbers):
            return numbers, ticks, f"times from the file names, in {unit} since 1970"
    if stepped := _unit_by_steps(numbers):
        return numbers, UNITS[stepped], f"times from the file names, in {stepped} by their steps"
    return numbers, 0, "frames in the order of the numbers in their names"


def _unit_by_steps(numbers: list[int]) -> str | None:
    """us or ns if these numbers step as the times of a camera do; None if they count frames.

    The times of three frames or more step by 1/250 s to 1/4 s, and by whole multiples of that where frames are missing.
    Frames that were picked at random from a long recording have numbers with large steps, too, but irregular ones.
    """
    steps = sorted(b - a for a, b in itertools.pairwise(sorted(numbers)))
    if len(steps) < 2:
        return None
    period = steps[len(steps) // 4]
    regular = sum(abs(step - round(step / period) * period) <= OFF_STEP * period for step in steps if period)
    if regular < REGULAR_SHARE * len(steps):
        return None
    slow, quick = CAMERA_RATES
    return next((unit for unit in ("us", "ns") if UNITS[unit] / quick <= period <= UNITS[unit] / slow), None)


def _columns(stems: list[str]) -> dict[tuple[str, ...], int]:
    """The index of the number that counts in otherwise equal names: the last that changes, else the last."""
    runs = defaultdict(list)
    for stem in stems:
        runs[_texts(stem)].append(re.findall(r"\d+", stem))
    return {
        texts: max((i for i, column in enumerate(zip(*rows)) if len(set(column)) > 1), default=len(rows[0]) - 1)
        for texts, rows in runs.items()
    }


def _texts(stem: str) -> tuple[str, ...]:
    """The parts of a name between its numbers."""
    return tuple(re.split(r"\d+", stem))
