"""The scores of a network of Table 1 on the test frames of a setting, for its entry in the results store."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from experiments.table1.settings import NEAR, Setting
from experiments.table1.store import DRAWN, JOINTS, THRESHOLDS_MM, Figures, Shown
from handpose.body import nyu
from handpose.fit.joints import angles
from handpose.fit.joints.fit_joints import fit_joints
from handpose.scoring import metrics
from handpose.scoring.held_out import Predictions, figures_of
from handpose.scoring.test_sets import crops_of
from layers.hand.bodies import kinematics_of
from layers.hand.skeleton import Skeleton
from netlib.blob import Array
from netlib.errors import DataError
from netlib.files.hdf5 import File
from netlib.net import Net

CHOSEN = list(nyu.EVALUATION_JOINTS)


@dataclass(frozen=True)
class Truth:
    """The labels of the test frames, except for their joints.

    fitted  (N, D) inputs of the hand fitted to the joints
    exact   (N, D) inputs that posed the frames; None for real ones
    bones   (N, K) signed lengths of the persons' bones in half-cubes; None if all have the skeleton's
    """

    fitted: Array
    exact: Array | None = None
    bones: Array | None = None


def truth_of(setting: Setting, fitted: Array) -> Truth:
    """The truth of a setting's test frames. Raises DataError."""
    files = setting.files("test")
    exact = _column(files, "dof", fitted.shape[1]) if setting.has_exact_angles else None
    return Truth(fitted, exact, _column(files, "bones", JOINTS) if setting.has_many_people else None)


def _column(files: list[Path], name: str, width: int) -> Array:
    """The rows (N, width) of a data set, of all files. Raises DataError."""
    parts = [File(path, (name,)).datasets[0].numbers() for path in files]
    for path, part in zip(files, parts):
        if part.shape[1:] != (width,) or not np.isfinite(part).all():
            raise DataError(f"{path}: data set {name!r} has shape {part.shape}, expected (N, {width}) finite numbers")
    return np.concatenate(parts)


def angles_of(
    predictions: Predictions, skeleton: Skeleton, progress: Callable[[int], None] = lambda done: None
) -> Array:
    """Inputs (N, D) of the hand that a network predicts: its own, or fitted within the limits to its joints."""
    if predictions.dof is not None:
        return np.where(skeleton.fixed, 0.0, predictions.dof.astype(np.float64))
    joints = predictions.joints.astype(np.float64)
    return fit_joints(skeleton, joints, limits=True, starts=4, progress=progress).inputs


def subjects_of(setting: Setting, half_cube: Array) -> dict[str, NDArray[np.bool_]]:
    """The test frames (N,) of each subject. Raises DataError for a frame of an unknown subject."""
    found = {name: np.full(len(half_cube), True) if size is None else np.abs(half_cube - size) < NEAR
             for name, size in setting.subjects.items()}
    unknown = ~np.any(list(found.values()), axis=0)
    if unknown.any():
        known = ", ".join(f"{size:g} ({name})" for name, size in setting.subjects.items())
        raise DataError(f"{setting.list_of('test')}: half_cube of frame {unknown.argmax()} is "
                        f"{half_cube[unknown][0]:g} mm, expected one of {known}")
    return {name: rows for name, rows in found.items() if rows.any()}


def figures(
    setting: Setting, predictions: Predictions, inputs: Array, truth: Truth, skeleton: Skeleton
) -> tuple[float, list[Figures]]:
    """The error in mm over all frames, and the figures of every subject; ``inputs`` are those of ``angles_of``."""
    errors = joint_errors(predictions.joints, predictions)
    found = []
    for name, rows in subjects_of(setting, predictions.half_cube).items():
        part = _part(predictions, rows)
        few = errors[rows][:, CHOSEN]
        fitted = angles.angle_errors(skeleton, inputs[rows], truth.fitted[rows])
        exact = None if truth.exact is None else angles.angle_errors(skeleton, inputs[rows], truth.exact[rows])
        of_part = figures_of(part, skeleton)
        calibrated, scaled = _with_bones(part, inputs[rows], truth.bones, rows, skeleton)
        found.append(Figures(
            subject=name,
            frames=int(rows.sum()),
            error_14_mm=of_part["error_14_mm"],
            error_mm=of_part["error_mm"],
            angle_deg=np.nan if exact is None else float(exact.mean()),
            fitted_angle_deg=float(fitted.mean()),
            out_of_limits=of_part.get("out_of_limits", np.nan),
            within_40_mm=of_part["within_40_mm"],
            own_bones_mm=calibrated,
            scaled_mm=scaled,
            joints_mm=metrics.mean_error_per_joint(errors[rows]).tolist(),
            success=metrics.success_rate(few, THRESHOLDS_MM).tolist(),
            angles_deg=(fitted if exact is None else exact).mean(axis=0).tolist(),
        ))
    return metrics.mean_error(errors[:, CHOSEN]), found


def joint_errors(joints: Array, predictions: Predictions) -> Array:
    """(N, K) mm between some joints (N, K, 3) in half-cubes and the true ones."""
    scale = predictions.half_cube[:, None, None]
    return metrics.joint_errors(joints * scale, predictions.truth * scale)


def _part(p: Predictions, rows: NDArray[np.bool_]) -> Predictions:
    """The predictions of some frames."""
    dof = None if p.dof is None else p.dof[rows]
    return Predictions(p.joints[rows], p.truth[rows], dof, None, p.half_cube[rows], p.outputs, p.made_from)


def _with_bones(
    part: Predictions, inputs: Array, bones: Array | None, rows: NDArray[np.bool_], skeleton: Skeleton
) -> tuple[float, float]:
    """The error in mm over the 14 joints for the angles on the frames' own bones, and on the skeleton's.

    The skeleton's are scaled for each frame by one factor, so that their total length is the frame's.
    """
    if bones is None or part.dof is None:
        return np.nan, np.nan
    own = bones[rows]
    scale = np.abs(own).sum(axis=1, keepdims=True) / np.abs(skeleton.bones).sum()
    kinematics = kinematics_of(skeleton)
    calibrated, scaled = (metrics.mean_error(joint_errors(kinematics.joints(inputs, b), part)[:, CHOSEN])
                          for b in (own, skeleton.bones * scale))
    return calibrated, scaled


def frames_to_show(setting: Setting, predictions: Predictions) -> list[int]:
    """Frames of the first subject, evenly spread over the test set; the same for every network."""
    rows = np.flatnonzero(next(iter(subjects_of(setting, predictions.half_cube).values())))
    return [int(rows[i]) for i in ((np.arange(DRAWN) + 0.5) / DRAWN * len(rows)).astype(int)]


def shown_frames(setting: Setting, predictions: Predictions, net: Net) -> Shown:
    """The frames to draw; ``net`` reads them."""
    numbers = frames_to_show(setting, predictions)
    return Shown(numbers, predictions.half_cube[numbers], predictions.truth[numbers], crops_of(net, numbers))
