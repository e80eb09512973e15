"""Published results: text files of predicted joints, and the figures by which methods are compared.

A file has a line for each test frame, and on it three numbers for each joint: ``u v d``
(px, px, mm) or ``x y z`` (mm, camera axes: x right, y up, z away; y down in the files of HANDS
2017). The name of the image may come first. Positions are absolute, so no crop centre is involved.

To compare angles, the hand model is fitted to the joints of every method. The annotation is fitted
within the limits with a ridge, which keeps angles that 14 joints do not determine at the initial
pose; predictions are fitted within the limits without a ridge. A method whose joints lie on the
model is fitted once more, without limits and from many starts, to count the frames with an angle
out of its limits.
"""

from __future__ import annotations

import contextlib
import re
from collections import Counter
from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any, Literal

import numpy as np

from handpose.body import nyu
from handpose.body.joint_formats.formats import FORMATS as JOINT_FORMATS
from handpose.body.model import FINGERS
from handpose.datasets import icvl_files as icvl
from handpose.fit.joints import angles
from handpose.fit.joints.fit_joints import fit_absolute
from handpose.frames.cameras import ICVL, NYU, Camera
from handpose.scoring import metrics
from layers.hand.skeleton import Skeleton
from netlib import files
from netlib.blob import Array
from netlib.errors import DataError
from netlib.files.paths import exists, find

Format = Literal["uvd", "xyz"]

COORDINATE_FORMATS: tuple[Format, ...] = ("uvd", "xyz")
NEAREST_MM = 100.0  # minimum range of depth cameras
THRESHOLDS_MM = range(81)  # abscissae of the success curves
# the name of an image before the numbers of a frame
IMAGE_NAME = re.compile(r"(\S*[A-Za-z]\S*\.[A-Za-z]{3,4})\s+")
_MAX_VALUE = 1e6  # px or mm; larger values are invalid, and squares might overflow


@dataclass(frozen=True)
class Benchmark:
    """The evaluation of results on a data set."""

    name: str
    camera: Camera
    joints: tuple[str, ...]  # K names, in the order of the files
    frames: int  # number of frames of the whole test set
    parts: dict[str, slice]  # slices of the test set with separate mean errors
    format: Format = "uvd"  # of its published files
    is_y_down: bool = False  # the axis of x y z in them


# also of BigHand2.2M
HANDS2017 = Camera("hands2017", 475.065948, 475.065857, 315.944855, 245.287079, 640, 480)
HANDS2017_JOINTS = (
    "wrist",
    *(f"{finger}_mcp" for finger in FINGERS),
    *(f"{finger}_{joint}" for finger in FINGERS for joint in ("pip", "dip", "tip")),
)
BENCHMARKS = {
    "nyu": Benchmark(
        "NYU",
        NYU,
        tuple(JOINT_FORMATS["nyu"].joints),
        nyu.TEST_FRAMES,
        {
            "subject 1": slice(nyu.SECOND_SUBJECT_INDEX),
            "subject 2": slice(nyu.SECOND_SUBJECT_INDEX, None),
        },
    ),
    # both sequences, one after the other
    "icvl": Benchmark("ICVL", ICVL, icvl.JOINTS, sum(icvl.TEST_SEQUENCE_FRAMES), {}),
    "hands2017": Benchmark(
        "HANDS 2017", HANDS2017, HANDS2017_JOINTS, 295510, {}, "xyz", is_y_down=True
    ),
}


def read_joints(path: str | Path, joints: int, fmt: Format, camera: Camera) -> Array:
    """Joints (N, K, 3) in mm, camera axes, of a file with N frames of K = ``joints``.

    Raises DataError.
    """
    return read_frames(path, joints, fmt, camera)[1]


def read_frames(
    path: str | Path, joints: int, fmt: Format, camera: Camera, is_y_down: bool = False
) -> tuple[list[str], Array]:
    """The names of the images, or none, and the joints (N, K, 3) in mm, camera axes, of a file.

    Raises DataError.

    is_y_down  of x y z in the file, which becomes y up
    """
    text = files.read_text(path, "the joints", limit=files.MAX_BYTES)
    if not text.strip():
        raise DataError(f"{path}: empty, expected the numbers of a frame on each line")
    names, found = _parsed(text.rstrip().split("\n"), joints, str(path))
    usual = float(np.median(np.abs(found[..., 2])))
    if usual < NEAREST_MM:
        raise DataError(
            f"{path}: half of all depths are below {usual:.3g}; expected mm, more than "
            f"{NEAREST_MM:g}: are they metres?"
        )
    if fmt == "xyz":
        return names, found * (1, -1, 1) if is_y_down else found
    depth = found[..., 2].min(axis=1)
    if (depth <= 0).any():
        first = int((depth <= 0).argmax())
        raise DataError(
            f"{path}:{first + 1}: found a joint at depth {depth[first]:g}, expected more than 0 mm "
            f"({(depth <= 0).sum()} of {len(depth)} frames have such joints)"
        )
    return names, camera.unproject(found)


def _parsed(lines: list[str], joints: int, where: str) -> tuple[list[str], Array]:
    """The names of the images, or none, and the numbers (N, K, 3) in lines. Raises DataError."""
    has_names = IMAGE_NAME.match(lines[0]) is not None
    names: list[str] = []
    rows = []
    for number, line in enumerate(lines, 1):
        start = 0
        if has_names:
            named = IMAGE_NAME.match(line)
            if named is None:
                raise DataError(f"{where}:{number}: no name of an image, as the lines before have")
            start = named.end()
            names.append(PurePosixPath(named[1].replace("\\", "/")).name)
        row = _numbers(line, start, f"{where}:{number}")
        if len(row) != 3 * joints:
            raise DataError(
                f"{where}:{number}: found {len(row)} number{'s' * (len(row) != 1)}, "
                f"expected {3 * joints} = {joints} joints x 3"
            )
        rows.append(row)
    if len(set(names)) < len(names):
        twice = next(name for name, count in Counter(names).items() if count > 1)
        raise DataError(f"{where}: has {twice} twice")
    return names, np.array(rows).reshape(-1, joints, 3)


def _numbers(line: str, start: int, where: str) -> Array:
    """The numbers of a line from a character on.

    Raises DataError for words, and for values that are too large.
    """
    words = line[start:].split()
    with contextlib.suppress(ValueError):
        row = np.array(words, np.float64)
        if (np.abs(row) < _MAX_VALUE).all():
            return row
    for word in re.finditer(r"\S+", line[start:]):
        try:
            is_good = abs(float(word[0])) < _MAX_VALUE
        except ValueError:
            is_good = False
        if not is_good:
            raise DataError(
                f"{where}:{start + word.start() + 1}: found {word[0][:40]!r}, "
                f"expected a number of px or mm, below {_MAX_VALUE:g}"
            )
    return np.array([float(word) for word in words])


def in_order(names: list[str], joints: Array, true_names: list[str], where: str) -> Array:
    """Predicted joints in the order of the ground truth, by the names of the images if
    both have them.

    Raises DataError for a missing image.
    """
    if not names or not true_names:
        return joints
    places = {name: place for place, name in enumerate(names)}
    if missing := [name for name in true_names if name not in places]:
        raise DataError(
            f"{where}: has no {missing[0]}, which the ground truth has ({len(missing)} such images)"
        )
    return joints[[places[name] for name in true_names]]


def is_list(path: str | Path) -> bool:
    """True if the first line names an existing file or an HDF5 file; False for an empty file."""
    try:
        begin = files.read_bytes(path, "the joints", first=1 << 16).decode("utf-8-sig", "replace")
    except DataError:
        return False  # ``read_joints`` raises the error
    first = begin.split("\n")[0].strip()
    return first.endswith((".h5", ".hdf5")) or (bool(first) and exists(find(first, str(path))))


@dataclass(frozen=True)
class Score:
    """The scores of a method. Errors are in mm; a success rate is a fraction of the frames."""

    mean_mm: float  # over all frames and joints
    # mean over each part of the test set; nothing if only some frames were given
    parts_mm: dict[str, float]
    median_max_mm: float  # median over the frames of the worst joint's error
    joints_mm: dict[str, float]  # mean over the frames, by joint
    success_max: list[float]  # frames whose worst joint is within each of THRESHOLDS_MM
    success_mean: list[float]  # the same for the mean error


def score_on(benchmark: Benchmark, errors: Array) -> Score:
    """The figures of a method on a benchmark from the errors (N, K) in mm of its joints."""
    parts = benchmark.parts if len(errors) == benchmark.frames else {}
    success_max = metrics.success_rate(errors, THRESHOLDS_MM)
    success_mean = metrics.success_rate(errors, THRESHOLDS_MM, worst=False)
    of_joints = errors.mean(axis=0).tolist()
    return Score(
        mean_mm=float(errors.mean()),
        parts_mm={name: float(errors[part].mean()) for name, part in parts.items()},
        median_max_mm=float(np.median(errors.max(axis=1))),
        joints_mm=dict(zip(benchmark.joints, of_joints)),
        success_max=success_max.tolist(),
        success_mean=success_mean.tolist(),
    )


# ------------------------------------------------------------------------------------------- angles

ANNOTATION_RIDGE = 3e-3  # ridge of the fits to the annotation
# residual of most frames if a hand model made their joints; with few starts some fit badly
ON_MODEL_MM = 0.05
TOLERANCE = 1e-3  # radians beyond a limit that count as within: joints in text files are rounded
# Gives the context of a fit, by its number of frames and `what`; its value is called with the
# number of further ones.
Watcher = Callable[..., AbstractContextManager[Callable[[int], None]]]


@dataclass(frozen=True)
class FittedAngles:
    """The result of fitting the hand model to the joints of a method."""

    error_deg: float  # mean over frames and rotations
    residual_mm: float  # mean distance that the fit within the limits leaves
    free_residual_mm: float  # the same without limits
    # fraction of the frames; None where the joints do not lie on the model
    out_of_limits: float | None


def compare_angles(
    skeleton: Skeleton,
    truth: Array,
    predictions: Mapping[str, Array],
    watch: Watcher = lambda total, what: nullcontext(lambda done: None),
) -> dict[str, FittedAngles]:
    """Fit the hand to NYU's true joints (N, 14, 3) in mm and to those of each
    method, and compare.
    """
    half = nyu.half_cubes(len(truth))

    def fitted(joints: Array, what: str, **options: Any) -> tuple[Array, Array]:
        """Inputs (N, D), and the mean remaining distance (N,) of each frame's joints in mm."""
        with watch(len(joints), what=what) as progress:
            found, _ = fit_absolute(
                skeleton, joints, half, nyu.EVALUATION_JOINTS, progress=progress, **options
            )
        return found.inputs, found.residuals.mean(axis=1)

    true_inputs, _ = fitted(truth, "annotation", ridge=ANNOTATION_RIDGE)
    results = {}
    for name, joints in predictions.items():
        inputs, residual = fitted(joints, name)
        free, free_residual = fitted(joints, f"{name}, no limits", limits=False, starts=2)
        broken = None
        if np.median(free_residual) < ON_MODEL_MM:
            free, free_residual = fitted(joints, f"{name}, exactly", limits=False, starts=256)
            broken = metrics.fraction_out_of_limits(
                free, skeleton.lower, skeleton.upper, skeleton.fixed, tolerance=TOLERANCE
            )
        error = float(angles.angle_errors(skeleton, inputs, true_inputs).mean())
        results[name] = FittedAngles(
            error, float(residual.mean()), float(free_residual.mean()), broken
        )
    return results
