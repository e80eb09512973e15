"""Files of joint angles: for the frames of a training set, by fitting the hand model to their
joints, and for others.

A net that learns the angles themselves (the paper's "direct parameter") needs them as labels, and a
real data set has only joints. Each HDF5 file of the set gets a small companion file with

    dof          (n, 47) inputs of the hand model, for its layer HandModel
    residual_mm  (n, 31) distance of each joint after the fit; NaN for joints that were
                 clipped to the cube

and the name of the original file, which has everything else (``netlib.files.hdf5.File``). So a list
of companions is read like the list of the original files.
"""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Sequence
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from handpose.datasets import labels, parts
from handpose.fit.joints.fit_joints import JointFit, fit_joints
from layers.hand.skeleton import Skeleton
from netlib.blob import Array
from netlib.errors import DataError, reason_of
from netlib.files import atomic, hdf5, make_folder, opened
from netlib.files.paths import exists, real
from netlib.files.reading import located

DESCRIPTION = (
    "dof: inputs of the hand model, radians, and half-cubes from center (mm, camera axes, y up)"
)
STARTS = 4  # of a fit
ANGLES_VERSION = 3  # increase after a change of the code that changes the angles


def write_fit(
    path: Path, found: JointFit, center: Array, half_cube: Array, index: NDArray[np.int_]
) -> None:
    """Write the angles and residuals of ``fit_absolute``, with its ``center`` (N, 3), to an HDF5
    file atomically.

    half_cube  (N,) mm
    index      (N,) numbers of the frames
    """
    make_folder(path.parent)
    with hdf5.created(path) as file:
        file["dof"], file["residual_mm"] = found.inputs, found.residuals
        file["index"], file["center"], file["half_cube"] = index, center, half_cube
        file.attrs["description"] = DESCRIPTION


def companions_of(files: Sequence[Path], out: Path) -> list[Path]:
    """The path of each file's companion.

    Raises DataError if two of them, or a file and its own, are the same.
    """
    targets = [out / path.name for path in files]
    for path, target in zip(files, targets):
        if real(path) == real(target):
            raise DataError(f"{target}: would replace the data themselves; choose another --out")
        if not hdf5.is_near(path, target):
            raise DataError(
                f"{target}: is not next to the folder of the data, {path}; expected --out "
                f"{real(path).parent}_angles, for example"
            )
    if len(set(targets)) < len(targets):
        raise DataError(f"{out}: two files of the list have the same name, expected different ones")
    return targets


def fit_list(
    files: Sequence[Path], out: Path, name: str, skeleton: Skeleton, **options: Any
) -> tuple[Array, Array]:
    """Write the companions of all files to a folder, with a list of this name. Raises DataError.

    Returns the inputs (N, D) of all frames and the residuals (N, K) in mm. ``options`` are those of
    ``fit_file``. Only companions of the same files are replaced.
    """
    targets = companions_of(files, out)
    _refuse_others(files, targets, out / name)
    for path, target in zip(files, targets):
        fit_file(path, target, skeleton, **options)
    atomic.replace_text(out / name, parts.list_text(targets))
    fits = [
        [dataset.numbers() for dataset in hdf5.File(path, ("dof", "residual_mm")).datasets]
        for path in targets
    ]
    inputs, residuals = map(np.concatenate, zip(*fits))
    return inputs, residuals


def _refuse_others(files: Sequence[Path], targets: Sequence[Path], names: Path) -> None:
    """Raise DataError unless the files to be replaced are companions of these files, or
    a list of them.
    """
    for path, target in zip(files, targets):
        if exists(target):
            rest = str((parts.attributes(target) or {}).get("rest_in", ""))
            if not rest or real(target.parent / rest) != real(path):
                raise DataError(
                    f"{target}: is not a companion of {path}; move it away, or choose another --out"
                )
    for name in parts.listed_names(names):
        if name not in [target.name for target in targets]:
            raise DataError(
                f"{names}: names {name!r}, which is not a companion of these files; move the list away, or "
                "choose another --out"
            )


def fit_file(
    path: Path,
    target: Path,
    skeleton: Skeleton,
    *,
    limits: bool = True,
    ridge: float = 0.0,
    progress: Callable[[int], None] = lambda done: None,
) -> None:
    """Fit the frames of one file and write its companion atomically. Raises DataError.

    An existing companion of the same file and options is kept.
    """
    recipe = _recipe_of(path, skeleton, limits, ridge)
    kept = parts.attributes(target)
    if kept is not None and kept.get("recipe") == recipe:
        progress(hdf5.File(target, ("dof",)).rows)
        return
    found_labels = labels.read(path, len(skeleton.parents))
    joints = np.where(found_labels.seen[..., None], found_labels.joints, np.nan)
    with located(path):
        found = fit_joints(
            skeleton, joints, limits=limits, ridge=ridge, starts=STARTS, progress=progress
        )
    rest = os.path.relpath(real(path), real(target.parent))
    try:
        make_folder(target.parent)
        with hdf5.created(target) as file:
            file["dof"] = found.inputs.astype(np.float32)
            file["residual_mm"] = (found.residuals * found_labels.half_cube[:, None]).astype(
                np.float32
            )
            file.attrs.update(recipe=recipe, made_from=found_labels.made_from, rest_in=rest)
    except OSError as error:
        raise DataError(f"{target}: {reason_of(error)}") from None


def _recipe_of(path: Path, skeleton: Skeleton, limits: bool, ridge: float) -> str:
    """All that the companion of a file depends on, as JSON. Raises DataError."""
    with opened(path, "the joints") as stream:
        stat = os.fstat(stream.fileno())
    values = {
        "version": ANGLES_VERSION,
        "skeleton": sha256(repr(skeleton.param).encode()).hexdigest(),
        "limits": limits,
        "ridge": ridge,
        "starts": STARTS,
        "source": path.name,
        "size": stat.st_size,
        "changed": stat.st_mtime_ns,
    }
    return json.dumps(values, sort_keys=True)
