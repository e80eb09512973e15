"""Published results: text files of predicted joints, and the figures by which methods are compared.

A file has a line for each test frame, and on it three numbers for each joint: ``u v d`` (px, px, mm) or ``x y z``
(mm, camera axes: x right, y up, z away). Positions are absolute, so no crop centre is involved.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from handpose.body import nyu
from handpose.datasets import icvl_files as icvl
from handpose.frames.cameras import ICVL, NYU, Camera
from handpose.scoring import metrics
from layers.hand import skeleton
from netlib import files
from netlib.blob import Array
from netlib.errors import DataError
from netlib.files.paths import exists, find

Format = Literal["uvd", "xyz"]

FORMATS: tuple[Format, ...] = ("uvd", "xyz")
NEAREST_MM = 100.0  # minimum range of depth cameras
THRESHOLDS_MM = range(81)  # abscissae of the success curves
_MAX_VALUE = 1e6  # px or mm; larger values are invalid, and squares might overflow


@dataclass(frozen=True)
class Benchmark:
    """The evaluation of results on a data set."""

    name: str
    camera: Camera
    joints: tuple[str, ...]  # K names, in the order of the files
    frames: int  # number of frames of the whole test set
    parts: dict[str, slice]  # slices of the test set with separate mean errors


def nyu_benchmark() -> Benchmark:
    """The 14 joints of NYU, by the names of the model's joints, and the two test subjects."""
    names = skeleton.load().joint_names
    return Benchmark(
        name="NYU",
        camera=NYU,
        joints=tuple(names[j] for j in nyu.EVALUATION_JOINTS),
        frames=nyu.TEST_FRAMES,
        parts={"subject 1": slice(nyu.SECOND_SUBJECT), "subject 2": slice(nyu.SECOND_SUBJECT, None)},
    )


def icvl_benchmark() -> Benchmark:
    """The 16 joints of ICVL, over both test sequences, one after the other."""
    return Benchmark(name="ICVL", camera=ICVL, joints=icvl.JOINTS, frames=sum(icvl.TEST_FRAMES), parts={})


BENCHMARKS = {"nyu": nyu_benchmark, "icvl": icvl_benchmark}


def read_joints(path: str | Path, joints: int, fmt: Format, camera: Camera) -> Array:
    """Joints (N, K, 3) in mm, camera axes, of a file with N frames of K = ``joints``. Raises DataError."""
    values = []
    lines = _text(path).rstrip().split("\n")
    for number, line in enumerate(lines, 1):
        try:
            row = [float(word) for word in line.split()]
        except ValueError:
            raise _mistake(f"{path}:{number}", line, joints) from None
        if len(row) != 3 * joints:
            raise _mistake(f"{path}:{number}", line, joints)
        values.append(row)
    found = np.array(values).reshape(-1, joints, 3)
    wrong = ~(np.abs(found) < _MAX_VALUE).all(axis=(1, 2))
    if wrong.any():
        first = int(wrong.argmax())
        raise _mistake(f"{path}:{first + 1}", lines[first], joints)
    usual = float(np.median(np.abs(found[..., 2])))
    if usual < NEAREST_MM:
        raise DataError(f"{path}: half of all depths are below {usual:.3g}; expected mm, more than "
                        f"{NEAREST_MM:g}: are they metres?")
    if fmt == "xyz":
        return found
    depth = found[..., 2].min(axis=1)
    if (depth <= 0).any():
        first = int((depth <= 0).argmax())
        raise DataError(f"{path}:{first + 1}: found a joint at depth {depth[first]:g}, expected more than 0 mm "
                        f"({(depth <= 0).sum()} of {len(depth)} frames have such joints)")
    return camera.unproject(found)


def is_list(path: str | Path) -> bool:
    """True if the first line names an existing file or an HDF5 file; False for an empty file."""
    try:
        begin = files.read_bytes(path, "the joints", first=1 << 16).decode("utf-8-sig", "replace")
    except DataError:
        return False  # ``read_joints`` raises the error
    first = begin.split("\n")[0].strip()
    return first.endswith((".h5", ".hdf5")) or (bool(first) and exists(find(first, str(path))))


def _text(path: str | Path) -> str:
    """The text of a file that is not empty. Raises DataError."""
    text = files.read_text(path, "the joints")
    if not text.strip():
        raise DataError(f"{path}: empty, expected the numbers of a frame on each line")
    return text


def _mistake(where: str, line: str, joints: int) -> DataError:
    """The error for an invalid line."""
    for word in re.finditer(r"\S+", line):
        if not _is_sensible(word[0]):
            return DataError(f"{where}:{word.start() + 1}: found {word[0][:40]!r}, "
                             f"expected a number of px or mm, below {_MAX_VALUE:g}")
    count = len(line.split())
    return DataError(f"{where}: found {count} number{'s' * (count != 1)}, expected {3 * joints} = {joints} joints x 3")


def _is_sensible(word: str) -> bool:
    try:
        return abs(float(word)) < _MAX_VALUE
    except ValueError:
        return False


@dataclass(frozen=True)
class Score:
    """The scores of a method. Errors are in mm; a success rate is a fraction of the frames."""

    mean_mm: float  # over all frames and joints
    parts_mm: dict[str, float]  # mean over each part of the test set; nothing if only some frames were given
    median_max_mm: float  # median over the frames of the worst joint's error
    joints_mm: dict[str, float]  # mean over the frames, by joint
    success_max: list[float]  # frames whose worst joint is within each of THRESHOLDS_MM
    success_mean: list[float]  # the same for the mean error


def score_on(benchmark: Benchmark, errors: Array) -> Score:
    """The figures of a method on a benchmark from the errors (N, K) in mm of its joints."""
    parts = benchmark.parts if len(errors) == benchmark.frames else {}
    return Score(
        mean_mm=metrics.mean_error(errors),
        parts_mm={name: metrics.mean_error(errors[part]) for name, part in parts.items()},
        median_max_mm=float(np.median(errors.max(axis=1))),
        joints_mm=dict(zip(benchmark.joints, metrics.mean_error_per_joint(errors).tolist())),
        success_max=metrics.success_rate(errors, THRESHOLDS_MM).tolist(),
        success_mean=metrics.success_rate(errors, THRESHOLDS_MM, worst=False).tolist(),
    )
