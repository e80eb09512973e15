"""Folders with a file for each depth frame, ordered and timed by their names.

FolderRecording(Path("frames"), given)          # all frames in it, which must be one sequence
FolderRecording(Path("frames/left_*.png"), given)    # those of one

    .png .tif       16-bit grey images
    .npy .npz       an array (height, width), in an .npz called depth or the only one; its other
                    arrays, of which those with the time of a frame count if the names have none,
                    as in ``stack``
    .raw            16-bit values of the camera's size without a header, the low byte first

The names give the order and the times of the frames: ``frame_names``.
"""

from __future__ import annotations

import contextlib
import fnmatch
import itertools
import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from handpose.frames.camera_places import next_to
from handpose.frames.cameras import Camera, View
from handpose.frames.formats import (
    CONVERTED,
    FROM_OTHERS,
    OF_ONE_FRAME,
    RAW,
    STACKS,
    conversion,
    is_pattern,
)
from handpose.frames.formats.frame_names import NANO, Reading, groups_of, in_order
from handpose.frames.formats.stack import arrays_in
from handpose.frames.formats.stack_parameters import (
    checked_times,
    name_of_times,
    not_used,
    parameters_in,
    unit_of_times,
)
from handpose.frames.images import (
    ALIGNED,
    OTHER_KIND,
    is_aligned,
    is_other_kind,
    read_picture,
    stored_depth,
)
from handpose.frames.recording import (
    UNKNOWN,
    CameraInfo,
    DepthDecoder,
    DepthFrame,
    NotDepthError,
    Recording,
)
from handpose.frames.time_units import FRAME_UNIT, TICKS
from netlib import files
from netlib.errors import DataError, did_you_mean, some_of, system_error_of
from netlib.files.paths import exists, list_folder, names_in

MIN_SIDE = 16  # px of a frame; labels and matrices have fewer rows or columns
BYTES = 2  # of a value without a header


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
        if own.camera is None and is_aligned(path, known.camera, origin):
            self.warnings = (*self.warnings, ALIGNED)
        if is_other_kind(path.parent.name, path.name):
            self.warnings = (*self.warnings, OTHER_KIND)
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

    Raises NotDepthError for another number of bytes, and for that of several sizes; and DataError.
    """
    content = files.read_bytes(path, "the frame")
    if not sizes:
        raise NotDepthError(
            f"{path}: {len(content)} bytes without a header, of unknown height and width; give them in a camera.json "
            "in the folder, with fx, fy, u0 and v0, or write PNG (rs-convert -p)"
        )
    fitting = [size for size in sizes if BYTES * math.prod(size) == len(content)]
    if len(fitting) != 1:
        advice = "; give a camera of one of these sizes" if fitting else ""
        possible = fitting or sizes
        known = [f"{BYTES * w * h}, {w} x {h}" for w, h in possible]
        raise NotDepthError(
            f"{path}: {len(content)} bytes; expected {', '.join(known)} depths of 16 bits without a "
            f"header{advice}"
        )
    width, height = fitting[0]
    return np.frombuffer(content, "<u2").reshape(height, width)


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
    # of a pattern as errors name it, whose stars stand for numbers
    (of_numbers,) = groups_of([source.name.replace("*", "0")])
    names = groups_of(names).get(of_numbers, names)
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
    groups = groups_of(names).values()
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
    if names and not advice:
        advice = f"; {FROM_OTHERS}"
    return f"{folder}: holds no depth frames (16-bit grey PNG or TIFF, .npy, .npz, .raw); found {shown}{advice}"
