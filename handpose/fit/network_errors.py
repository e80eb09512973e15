"""The errors of a network, and natural poses, measured once and stored in the weights file.

A weights file in Caffe's HDF5 layout has a group ``data``; a group ``fit`` next to it, which
Caffe ignores, has

    fit/limbs          (L, L) covariance of the errors of the limbs' inputs: spread of further
                       starts, and prior
    fit/poses          (L + 1, L) mean of the limbs' inputs in natural poses, and below it their
                       covariance; optional
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from handpose.fit.body import CapsuleModel
from netlib.blob import Array
from netlib.errors import DataError
from netlib.files import Content, hdf5
from netlib.snapshots import snapshot

GROUP = "fit"
LIMBS, POSES = "limbs", "poses"
POSE_STD = 0.02  # radians: added to the deviations of natural poses
UNKNOWN_STD = 0.3  # radians: assumed error of the limbs of a network whose errors were not measured


class Poses(NamedTuple):
    """The distribution of natural poses: mean (L,) and covariance (L, L) of the limbs' inputs."""

    mean: Array
    covariance: Array

    @classmethod
    def of(cls, limbs: Array) -> Poses:
        """That of poses (N, L); a limb that moves in none is as if it moved by POSE_STD."""
        mean = limbs.mean(axis=0)
        return cls(mean, covariance(limbs - mean) + np.eye(len(mean)) * POSE_STD**2)


@dataclass(frozen=True)
class NetworkErrors:
    """The errors of a network.

    limbs        (L, L) covariance of the errors of the limbs' inputs
    poses        natural poses; None if they are unknown
    is_measured  False for assumed errors: then nothing is known of the fits after this network
    """

    limbs: Array
    poses: Poses | None = None
    is_measured: bool = True


def unknown_errors(model: CapsuleModel) -> NetworkErrors:
    """The default errors of a network that was not measured."""
    return NetworkErrors(np.eye(len(model.limbs)) * UNKNOWN_STD**2, is_measured=False)


def read_errors(path: str | Path | Content, model: CapsuleModel) -> NetworkErrors:
    """The errors in a weights file, or the default ones if it has none. Raises DataError."""
    if not snapshot.begins_as_hdf5(path, "weights"):
        return unknown_errors(model)
    with hdf5.opened(path, f"the group {GROUP!r}") as file:
        if GROUP not in file:
            return unknown_errors(model)
        found = {
            name: np.asarray(file[GROUP][name], np.float64)
            for name in (LIMBS, POSES)
            if name in file[GROUP]
        }
    limbs = found.get(LIMBS, np.zeros(0))
    poses = found.get(POSES)
    L = len(model.limbs)
    if limbs.shape != (L, L) or not _is_covariance(limbs):
        raise DataError(
            f"{path}: {GROUP}/{LIMBS} of shape {limbs.shape}, expected a covariance ({L}, {L})"
        )
    if poses is None:
        return NetworkErrors(limbs)
    is_finite = np.isfinite(poses).all()
    if poses.shape != (L + 1, L) or not is_finite or not _is_covariance(poses[1:]):
        raise DataError(
            f"{path}: {GROUP}/{POSES} of shape {poses.shape}, expected a mean and a covariance ({L + 1}, {L})"
        )
    return NetworkErrors(limbs, Poses(poses[0], poses[1:]))


def _is_covariance(values: Array) -> bool:
    return bool(np.isfinite(values).all() and np.linalg.eigvalsh(values).min(initial=1.0) > 0)


def arrays_of(errors: NetworkErrors) -> dict[str, Array]:
    """The arrays of a file's group ``fit`` by name, as ``read_errors`` reads them."""
    return {LIMBS: errors.limbs} | (
        {} if errors.poses is None else {POSES: np.vstack(errors.poses)}
    )


def covariance(errors: Array) -> Array:
    """(L, L) of errors (N, L), about 0."""
    return errors.T @ errors / len(errors)
