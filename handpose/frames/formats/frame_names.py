"""The order and times of frames by their names: numbers, time stamps, and how to distinguish them.

    0001.png frame_7.png                      numbers; one frame period each
    20210326-230536_110.png                   a sequence that began then, and a number in it
    20210326-230536.png 20210326_230537.png   dates, with or without fractions of a second (dates.py)
    1616799936.125.png 0.033.png              seconds with a fraction; with 13 digits, ms since 1970 with one
    51234.5000.png 51267.8333.png             ms by their steps
    v1.1.png v1.2.png                         numbers: seconds that do not count from 1970 have 3 digits of fraction
    1616799936125.png 1616799936_125000.png   s, ms, us or ns since 1970, by their size; s with a fraction
    790154000_depth.png 790187333_depth.png   us or ns since the camera started, by their steps
    z_34512.png z_34545.png                   ms since the camera started, by their steps
    000000033333us.png                        us, ms or ns as named, as ``tools/record.py`` writes
    00012_1616799936125.png                   a count and a time, in any order: the time

The texts between the numbers of a sequence are equal, and so are all numbers except the time and those that ascend with
it: a count, or another clock.
"""

from __future__ import annotations

import itertools
import re
from collections import defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import PurePath
from statistics import median

from handpose.frames.formats.name_times import Reading, reading, texts
from netlib.errors import DataError

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


def in_order(names: Iterable[str], where: str, unit: str | None = None) -> NamedFrames:
    """The frames with these names. Raises DataError for several sequences, and for two frames of the same moment.

    unit  of the times in the names, "frames" if they are numbers; inferred by default
    """
    names = sorted(names)
    groups: dict[tuple[object, ...], list[str]] = defaultdict(list)
    for name in names:
        groups[texts(PurePath(name).stem), PurePath(name).suffix.lower()].append(name)
    one_kind = len({suffix for _, suffix in groups}) == 1
    found = reading([PurePath(name).stem for name in names], unit) if one_kind else None
    if found is None or not found.ticks:
        for name in names:
            if (digits := max((len(run.lstrip("0")) for run in re.findall(r"\d+", name)), default=0)) > MAX_DIGITS + 1:
                raise DataError(f"{where}: {name}: a number of {digits} digits; expected a frame's number or time")
    if found is not None:
        return _sorted(names, found, where)
    sequences = sorted(pattern for group in groups.values() for pattern in _sequences(group, unit))
    more = f" and {len(sequences) - MAX_SHOWN} more" if len(sequences) > MAX_SHOWN else ""
    shown = ", ".join(f"{pattern} ({count})" for pattern, count in sequences[:MAX_SHOWN])
    raise DataError(f"{where}: holds {len(sequences)} sequences: {shown}{more}; name one, as "
                    f"'{where}/{sequences[0][0]}'")


def _sorted(names: Sequence[str], found: Reading, where: str) -> NamedFrames:
    times, ticks, how = found.times, found.ticks, found.how
    order = sorted(range(len(names)), key=lambda i: times[i])
    for a, b in itertools.pairwise(order):
        if times[a] == times[b]:
            raise DataError(f"{where}: {names[a]} and {names[b]} are frames of the same moment; remove one of them")
    first = times[order[0]]
    if not ticks and (missing := times[order[-1]] - first + 1 - len(names)):
        how += f"; numbers missing between {first} and {times[order[-1]]}: {missing}, which stay gaps in time"
    if ticks and len(names) > 1:
        step = median(times[b] - times[a] for a, b in itertools.pairwise(order))
        how += f": a frame every {1000 * step / ticks:.3g} ms"
    return NamedFrames(tuple(names[i] for i in order), tuple(times[i] - first for i in order), ticks, how)


def _sequences(names: list[str], unit: str | None) -> list[tuple[str, int]]:
    """The sequences in names of equal texts: a pattern of the names of each, and their number."""
    stems = [PurePath(name).stem for name in names]
    if reading(stems, unit) is not None:
        return [(_pattern(names), len(names))]
    columns = list(zip(*(re.findall(r"\d+", stem) for stem in stems)))
    keys = [column for column in columns if 1 < len(set(column)) < len(stems)]
    for key in sorted(keys, key=lambda column: len(set(column))):
        parts: dict[str, list[str]] = defaultdict(list)
        for name, value in zip(names, key):
            parts[value].append(name)
        if all(reading([PurePath(name).stem for name in part], unit) is not None for part in parts.values()):
            return [(_pattern(part), len(part)) for part in parts.values()]
    last = max(i for i, column in enumerate(columns) if len(set(column)) > 1)
    rest: dict[tuple[str, ...], list[str]] = defaultdict(list)
    for name, row in zip(names, zip(*columns)):
        rest[row[:last] + row[last + 1 :]].append(name)
    return [(_pattern(part), len(part)) for part in rest.values()]


def _pattern(names: list[str]) -> str:
    """A pattern of names of equal texts: a star for each number that changes, or for the last one."""
    between, suffix = texts(PurePath(names[0]).stem), PurePath(names[0]).suffix
    columns = list(zip(*(re.findall(r"\d+", PurePath(name).stem) for name in names)))
    changes = [len(set(column)) > 1 for column in columns]
    if columns and not any(changes):
        changes[-1] = True
    numbers = ["*" if change else column[0] for change, column in zip(changes, columns)]
    return "".join(itertools.chain(*itertools.zip_longest(between, numbers, fillvalue=""))) + suffix
