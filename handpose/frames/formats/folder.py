"""Folders with a file for each depth frame, ordered and timed by their names.

FolderRecording(Path("frames"), given)          # all frames in it, which must be one sequence
FolderRecording(Path("frames/left_*.png"), given)    # those of one

    .png .tif       16-bit grey images
    .npy .npz       an array (height, width), in an .npz called depth or the only one; its other
                    arrays, of which those with the time of a frame count if the names have none,
                    as in ``stack``
    .raw            16-bit values of the camera's size without a header, the low byte first

    000000033333us.png                      us, ms or ns as named, as ``tools/record.py`` writes
    1616799936125.png 1616799936.125.png    s, ms, us or ns since 1970, by their size, also
                                            with a fraction
    00012_1616799936125.png                 a count and such a time, in any order: the time
    0.033333.png                            s, if the frames are less than a second apart
    0001.png frame_7.png 34512.png          other numbers count frames, one frame period each,
                                            unless a unit is given
    2021-03-26 23h05m36s125.png             of dates only the order is used: one frame period each

The texts between the numbers of a sequence are equal, and so are all numbers except the time and
those that ascend with it.
"""

from __future__ import annotations

import contextlib
import fnmatch
import glob
import itertools
import re
from collections import defaultdict
from collections.abc import Iterable, Iterator, Sequence
from decimal import Decimal
from pathlib import Path, PurePath
from statistics import median
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from handpose.frames.camera_file import NAME
from handpose.frames.camera_places import next_to
from handpose.frames.cameras import Camera, View
from handpose.frames.formats import CONVERTED, OF_ONE_FRAME, RAW, STACKS, conversion, is_pattern
from handpose.frames.formats.stack import (
    arrays_in,
    checked_times,
    name_of_times,
    not_used,
    parameters_in,
    unit_of_times,
)
from handpose.frames.images import ALIGNED, is_aligned, read_picture, stored_depth
from handpose.frames.recording import (
    UNKNOWN,
    CameraInfo,
    DepthDecoder,
    DepthFrame,
    NotDepthError,
    Recording,
)
from handpose.frames.time_units import FRAME_UNIT, TICKS, since_1970
from netlib import files
from netlib.errors import DataError, did_you_mean, some_of, system_error_of
from netlib.files.paths import exists, list_folder, names_in


class FolderRecording(Recording):
    """The frames in a folder, those that match a pattern of names, or one, in the order of time.

    Raises DataError.

    Damaged ones are left out, and ``remarks`` counts them.

    folder  of the frames
    """

    def __init__(self, source: Path, given: CameraInfo = UNKNOWN) -> None:
        self.folder, names = _frames_in(source)
        camera_json = next_to(self.folder, given.camera is None)
        known = given.or_else(camera_json)
        self._given = known.camera
        self._sizes = _sizes_of(given, camera_json)
        self._names, self._reading = in_order(names, str(self.folder), known.time_unit)
        self._remarks: tuple[str, ...] = ()
        _, path, raw = next(self._whole_frames())
        where = str(path)
        if path.suffix.lower() in (".tif", ".tiff") and (pictures := cv2.imcount(where)) > 1:
            raise DataError(
                f"{path}: a TIFF of {pictures} pictures; expected one for each frame, or all in an .npy"
            )
        own = UNKNOWN
        taken: list[str] = []
        if path.suffix.lower() in STACKS:
            own, taken = self._parameters_of(path, given, camera_json)
        self._decode_by(DepthDecoder(raw.shape, raw.dtype, where, given, own, camera_json))
        origin = given.origin if given.camera else camera_json.origin
        is_meant = origin in ("", "--camera") or origin.endswith(NAME)
        is_known = own.camera or (isinstance(known.camera, Camera) and is_meant)
        if not is_known and is_aligned(path):
            self.warnings = (*self.warnings, ALIGNED)
        self.name = str(source)
        self.count = len(names)
        self.remarks = (self._reading.how, *taken, *self.remarks)
        if not self._reading.ticks and len(names) > 1:
            self._assume_rate()
        self._remarks = self.remarks

    def _parameters_of(
        self, first: Path, given: CameraInfo, camera_json: CameraInfo
    ) -> tuple[CameraInfo, list[str]]:
        """The parameters in the first of several archives, and a remark about them; takes the times
        in the archives unless the names have them. Raises DataError.
        """
        arrays = arrays_in(first, is_single=True)
        own, fields, taken = parameters_in(arrays.others, str(first), given)
        timed = name_of_times(arrays.others, 1)
        self.warnings = not_used(arrays.names, fields, timed)
        if timed is not None:
            # a given unit is that of the arrays
            by_names, reading = in_order(self._names, str(self.folder))
            if not reading.ticks:
                self._names, self._reading = by_names, reading
                self._reading = self._timed_by(timed, given, own, camera_json)
        return own, taken

    def _timed_by(
        self, name: str, given: CameraInfo, own: CameraInfo, camera_json: CameraInfo
    ) -> Reading:
        """The times in an array of each file, in the order of the names.

        Raises DataError unless they ascend.
        """
        found: dict[int, NDArray[Any]] = {}
        for number, file in enumerate(self._names):
            with contextlib.suppress(DataError):  # of a damaged frame, which is left out
                found[number] = arrays_in(self.folder / file, is_single=True).others.get(
                    name, np.zeros(0)
                )
        where = f"{self.folder}: {name}"
        numbers = checked_times(
            np.concatenate([values.ravel() for values in found.values()]), len(found), where
        )
        unit, how = unit_of_times(
            name, numbers, str(self.folder), given.time_unit, own, camera_json
        )
        ticks = 0 if unit == FRAME_UNIT else NANO
        factor = ticks / TICKS[unit] if ticks else 1
        steps = np.rint((numbers - numbers[0]) * factor).astype(int)
        times = dict(zip(found, steps.tolist()))
        in_place = [times.get(number, 0) for number in range(len(self._names))]
        return self._reading._replace(
            times=in_place, ticks=ticks, how=f"times from {name!r} of each frame, {how}"
        )

    def __iter__(self) -> Iterator[DepthFrame]:
        """The frames that can be read.

        Raises DataError for one of another size or kind, and for a system error.
        """
        ticks = self._reading.ticks or self.rate or 1.0
        for number, path, values in self._whole_frames():
            yield DepthFrame(
                number, self._reading.times[number] / ticks, self._decode(values, str(path))
            )

    def _whole_frames(self) -> Iterator[tuple[int, Path, NDArray[Any]]]:
        """The stored values of all frames that are whole, with their numbers. Raises DataError.

        Files are whole and not depth: an error. If all are damaged, the error is that of the first.
        """
        damaged: list[DataError] = []
        for number, name in enumerate(self._names):
            path = self.folder / name
            try:
                values = self._read(path)
            except DataError as error:
                if isinstance(error, NotDepthError) or system_error_of(error):
                    raise
                damaged.append(error)
                self.remarks = (
                    *self._remarks,
                    f"{len(damaged)} damaged frames are left out, the first: {damaged[0]}",
                )
            else:
                yield number, path, values
        if len(damaged) == len(self._names):
            raise damaged[0]

    def _read(self, path: Path) -> NDArray[Any]:
        """The stored values of a frame.

        Raises NotDepthError, and another DataError for a damaged file.
        """
        suffix = path.suffix.lower()
        if suffix in STACKS:
            (values,) = arrays_in(path, is_single=True)
            return values
        if suffix == RAW:
            return _raw(path, self._sizes)
        return stored_depth(read_picture(path), self._given, path)


def _sizes_of(*infos: CameraInfo) -> list[tuple[int, int]]:
    """The widths and heights in px that the first camera with a size may have."""
    for info in infos:
        if isinstance(info.camera, View) and info.camera.sizes:
            return list(info.camera.sizes)
        if isinstance(info.camera, Camera) and info.camera.width:
            return [(info.camera.width, info.camera.height)]
    return []


def _raw(path: Path, sizes: Sequence[tuple[int, int]]) -> NDArray[np.uint16]:
    """The values of a file without a header.

    Raises NotDepthError for another number of bytes, and DataError.
    """
    content = files.read_bytes(path, "the frame")
    if not sizes:
        raise NotDepthError(
            f"{path}: {len(content)} bytes without a header, of unknown height and width; give them in a camera.json "
            "in the folder, with fx, fy, u0 and v0, or write PNG (rs-convert -p)"
        )
    expected = {BYTES * width * height: (height, width) for width, height in sizes}
    if len(content) not in expected:
        known = ", ".join(
            f"{count}, {width} x {height}" for count, (height, width) in expected.items()
        )
        raise NotDepthError(
            f"{path}: {len(content)} bytes; expected {known} depths of 16 bits without a header"
        )
    return np.frombuffer(content, "<u2").reshape(expected[len(content)])


def _frames_in(source: Path) -> tuple[Path, list[str]]:
    """The folder, and the names of all frames in it, of those that fit a pattern, or
    of a single one.
    """
    if exists(source) and source.is_dir():
        names = _without_other_arrays(
            source, [name for name in list_folder(source) if _is_frame(name)]
        )
        if not names:
            raise DataError(_no_frames(source))
        return source, names
    if exists(source):
        return source.parent, [source.name]
    there = list_folder(source.parent) if exists(source.parent) else set()
    names = [name for name in fnmatch.filter(there, source.name) if _is_frame(name)]
    if not names:
        said = "no frame has such a name" if is_pattern(source) else "no such file or folder"
        raise DataError(f"{source}: {said}{did_you_mean(source.name, there)}")
    return source.parent, names


def _is_frame(name: str) -> bool:
    return not name.startswith(".") and name.lower().endswith(OF_ONE_FRAME)


def _without_other_arrays(folder: Path, names: list[str]) -> list[str]:
    """The names without the groups of arrays that cannot be depth: colours, labels, a matrix K.npy.

    All names, if there is no other group.
    """
    groups = _groups(names).values()
    if len(groups) < 2:
        return names
    possible = [group for group in groups if _may_be_depth(folder, group)]
    return list(itertools.chain(*possible)) or names


def _may_be_depth(folder: Path, group: list[str]) -> bool:
    """Whether the first whole file of a group is a picture, or an array that may be depth."""
    for path in (folder / name for name in group):
        if path.suffix.lower() not in STACKS:
            return True
        try:
            return min(arrays_in(path, is_single=True).shape[1:]) >= MIN_SIDE
        except NotDepthError:
            return False
        except DataError as error:
            if system_error_of(error):
                raise
    return False


def _no_frames(folder: Path) -> str:
    """The error for a folder without frames, with what it contains."""
    names = sorted(name for name in names_in(folder) if not name.startswith("."))
    shown = some_of(names) or "nothing"
    paths = [folder / name for name in names]
    inner = next((path for path in paths if "depth" in path.name.lower() and path.is_dir()), None)
    other = next((path for path in paths if path.suffix.lower() in CONVERTED), None)
    advice = f"; name the folder of the frames, as '{inner}'" if inner else ""
    if other is not None:
        advice = f"; {other}: {conversion(other)}"
    return f"{folder}: holds no depth frames (16-bit grey PNG or TIFF, .npy, .npz, .raw); found {shown}{advice}"


# -------------------------------------------------------------------------------------------- names

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
MIN_TIMES = 3  # that show whether leading zeros lack
MIN_SIDE = 16  # px of a frame; labels and matrices have fewer rows or columns
BYTES = 2  # of a value without a header


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
    groups = _groups(names)
    found = _reading(names, unit) if len(groups) == 1 else None
    if found is not None:
        return _sorted(names, found, where)
    by_number = _reading(names, FRAME_UNIT) if len(groups) == 1 and unit is None else None
    if by_number is not None and _range(by_number) < SPARSE * len(names):
        raise DataError(
            f"{where}: the times in the names, as in {names[0]}, do not ascend with the frames' numbers; --time-unit "
            "frames takes these alone"
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


def _groups(names: Iterable[str]) -> dict[tuple[str, ...], list[str]]:
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
    """True if all numbers besides the time are constant or ascend with it; besides the number
    of a frame, times since 1970 may do neither.
    """
    order = sorted(range(len(found.times)), key=lambda i: found.times[i])
    columns = zip(*(map(int, DIGITS.findall(found.rests[i])) for i in order))
    changing = [
        column
        for column in columns
        if len(set(column)) > 1 and not (are_frames and since_1970(column))
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
    """Numbers with their unit, which is one of the equal texts."""
    for matches in _in_columns(stems, NAMED_UNIT):
        unit = matches[0][2]
        times = [int(match[1]) * (NANO // TICKS[unit]) for match in matches]
        yield _read(stems, matches, times, NANO, f"times from the file names, in {unit}")


def _since_1970(stems: list[str]) -> Iterator[Reading]:
    """Times since 1970, also with a fraction; those with the smallest range first, because the
    ticks of a clock may look like them.
    """
    found: list[Reading] = []
    for matches in _in_columns(stems, SINCE_1970):
        unit = since_1970([int(match[1]) for match in matches])
        if unit is not None:
            digits = len(str(NANO // TICKS[unit])) - 1  # of the fraction, down to a nanosecond
            times = _with_fractions(matches, digits)
            how = f"times from the file names, in {unit} since 1970"
            found.append(_read(stems, matches, times, NANO, how))
    yield from sorted(found, key=_range)


def _with_fractions(matches: list[re.Match[str]], digits: int) -> list[int]:
    """The whole numbers that SINCE_1970 matches with their fractions of so many digits.

    Fractions of several lengths may be numbers of us or ns that lack leading zeros. They are if the
    largest step of at least three times is smaller then.
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
