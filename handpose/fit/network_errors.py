"""The errors of a network and of the fits after it, and natural poses, measured once and stored in the weights file.

A weights file in Caffe's HDF5 layout has a group ``data``; a group ``fit`` next to it, which Caffe ignores, has

    fit/limbs          (L, L) covariance of the errors of the limbs' inputs: spread of further starts, and prior
    fit/poses          (L + 1, L) mean of the limbs' inputs in natural poses, and below it their covariance; optional
    fit/PLAN           (k, 3) for each plan, ascending: uncertainty, expected error in mm, P(error < 30 mm)
    fit/PLAN.signs     (5,) weights >= 0 with the sum 1, for the uncertainty

The parts of the cost predict failures better than their sum: a limb outside the silhouette (outline) is a worse sign
than a thick body (surface). So the uncertainty is the weighted geometric mean of 1 + each sign. Its weights are those
that best separate failed fits from others (logistic regression). The signs are the four parts of the cost, and the
distance in mm by which the joints moved.
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
GOOD_MM = 30.0  # a fit with a larger error has failed
POSE_STD = 0.02  # radians: added to the deviations of natural poses
UNKNOWN_STD = 0.3  # radians: assumed error of the limbs of a network whose errors were not measured
LOST_MM = 150.0  # upper bound of expected errors: then the hand is elsewhere
KNOTS = 24  # maximum number of rows of a table
SIGNS = ("surface", "outline", "front", "prior", "moved")
_SUFFIX = ".signs"
_RIDGE = 1e-4  # keeps weights finite where failures are separable


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
    """The measured errors of a network.

    limbs    (L, L) covariance of the errors of the limbs' inputs
    tables   for each measured plan (k, 3): uncertainty, expected error in mm, probability of an error below GOOD_MM
    weights  for each measured plan (5,): of the signs
    poses    natural poses; None if they are unknown
    """

    limbs: Array
    tables: dict[str, Array]
    weights: dict[str, Array]
    poses: Poses | None = None

    def expected(self, plan: str, signs: Array) -> tuple[Array, Array, Array]:
        """Uncertainty, expected error in mm, and probability of an error below GOOD_MM, (N,) each, for signs (N, 5).

        For a plan without a table the weights are equal, and error and probability are NaN. For an uncertainty beyond
        the table the error grows in proportion, up to LOST_MM, and the probability falls.
        """
        uncertainty = uncertainty_of(signs, self.weights.get(plan, np.full(len(SIGNS), 1 / len(SIGNS))))
        table = self.tables.get(plan)
        if table is None:
            return uncertainty, np.full(len(uncertainty), np.nan), np.full(len(uncertainty), np.nan)
        beyond = np.maximum(uncertainty / table[-1, 0], 1)
        return (
            uncertainty,
            np.minimum(np.interp(uncertainty, table[:, 0], table[:, 1]) * beyond, LOST_MM),
            np.interp(uncertainty, table[:, 0], table[:, 2]) / beyond,
        )


def unknown_errors(model: CapsuleModel) -> NetworkErrors:
    """The default errors of a network that was not measured."""
    return NetworkErrors(np.eye(len(model.limbs)) * UNKNOWN_STD**2, {}, {})


def read_errors(path: str | Path | Content, model: CapsuleModel) -> NetworkErrors:
    """The errors in a weights file, or the default ones if it has none. Raises DataError."""
    if not snapshot.begins_as_hdf5(path, "weights"):
        return unknown_errors(model)
    with hdf5.opened(path, f"the group {GROUP!r}") as file:
        if GROUP not in file:
            return unknown_errors(model)
        found = {name: np.asarray(item, dtype=np.float64) for name, item in file[GROUP].items()}
    limbs = found.pop(LIMBS, np.zeros(0))
    L = len(model.limbs)
    if limbs.shape != (L, L) or not _is_covariance(limbs):
        raise DataError(f"{path}: {GROUP}/{LIMBS} of shape {limbs.shape}, expected a covariance ({L}, {L})")
    poses = found.pop(POSES, None)
    if poses is not None and (
        poses.shape != (L + 1, L) or not np.isfinite(poses).all() or not _is_covariance(poses[1:])
    ):
        raise DataError(
            f"{path}: {GROUP}/{POSES} of shape {poses.shape}, expected a mean and a covariance ({L + 1}, {L})"
        )
    weights = {name.removesuffix(_SUFFIX): found.pop(name) for name in list(found) if name.endswith(_SUFFIX)}
    if set(weights) != set(found):
        raise DataError(f"{path}: {GROUP}: {', '.join(sorted(set(weights) ^ set(found)))}: a table without weights of "
                        "signs, or weights without a table; package the weights again")
    for name, own in weights.items():
        if own.shape != (len(SIGNS),) or not (own >= 0).all() or not np.isclose(own.sum(), 1):
            raise DataError(f"{path}: {GROUP}/{name}{_SUFFIX} of shape {own.shape}, expected {len(SIGNS)} weights with "
                            "the sum 1")
    for name, table in found.items():
        good = table.ndim == 2 and table.shape[1:] == (3,) and len(table) > 1 and np.isfinite(table).all()
        if not good or table[0, 0] <= 0 or (np.diff(table[:, 0]) <= 0).any():
            raise DataError(
                f"{path}: {GROUP}/{name} of shape {table.shape}, expected rows of uncertainty, error, chance"
            )
    return NetworkErrors(limbs, found, weights, None if poses is None else Poses(poses[0], poses[1:]))


def _is_covariance(values: Array) -> bool:
    return bool(np.isfinite(values).all() and np.linalg.eigvalsh(values).min(initial=1.0) > 0)


def arrays_of(errors: NetworkErrors) -> dict[str, Array]:
    """The arrays of a file's group ``fit`` by name, as ``read_errors`` reads them."""
    weights = {plan + _SUFFIX: own for plan, own in errors.weights.items()}
    poses = {} if errors.poses is None else {POSES: np.vstack(errors.poses)}
    return {LIMBS: errors.limbs, **poses, **errors.tables, **weights}


def uncertainty_of(signs: Array, weights: Array) -> Array:
    """The uncertainty (N,): the geometric mean of 1 + each of the signs (N, 5), weighted (5,)."""
    return np.asarray(np.exp(np.log1p(signs) @ weights))


def weights_of(signs: Array, error_mm: Array) -> Array:
    """The weights (5,) with which the uncertainty best separates fits with errors beyond GOOD_MM from the others.

    signs     (N, 5) of fits
    error_mm  (N,) of their joints
    """
    from scipy.optimize import minimize  # imported here: it takes a third of a second

    shown = np.isfinite(signs).all(axis=1)  # crops that show nothing have infinite signs
    X, failed = np.log1p(signs[shown]), error_mm[shown] > GOOD_MM
    if not failed.any() or failed.all():
        return np.full(len(SIGNS), 1 / len(SIGNS))
    side = np.where(failed, 1.0, -1.0)

    def loss(w: Array) -> tuple[float, Array]:
        margin = side * (X @ w[:-1] + w[-1])
        slope = -side / (1 + np.exp(np.clip(margin, -500, 500))) / len(side)
        gradient = np.append(X.T @ slope + 2 * _RIDGE * w[:-1], slope.sum())
        return float(np.logaddexp(0, -margin).mean() + _RIDGE * (w[:-1] ** 2).sum()), gradient

    bounds = [(0, None)] * len(SIGNS) + [(None, None)]
    w = minimize(loss, np.zeros(len(SIGNS) + 1), jac=True, method="L-BFGS-B", bounds=bounds).x[:-1]
    return np.asarray(w / w.sum()) if w.sum() > 0 else np.full(len(SIGNS), 1 / len(SIGNS))


def covariance(errors: Array) -> Array:
    """(L, L) of errors (N, L), about 0."""
    return np.asarray(errors.T @ errors / len(errors))


def table_of(uncertainty: Array, error_mm: Array) -> Array:
    """The table (k, 3) for fits with these uncertainties (N,) and errors of their joints (N,) in mm. Raises DataError.

    Means of groups of equal size, made ascending by pooling neighbours in the wrong order (isotonic regression).
    """
    shown = np.isfinite(uncertainty)  # crops that show nothing have no finite uncertainty and need no table
    uncertainty, error_mm = uncertainty[shown], error_mm[shown]
    order = np.argsort(uncertainty, kind="stable")
    groups = [group for group in np.array_split(order, KNOTS) if len(group)]
    x = np.array([uncertainty[g].mean() for g in groups])
    y = _pooled(np.array([error_mm[g].mean() for g in groups]))
    chance = 1 - _pooled(np.array([(error_mm[g] > GOOD_MM).mean() for g in groups]))
    apart = np.append(True, np.diff(x) > 0)
    if apart.sum() < 2:
        raise DataError(f"{len(uncertainty)} fits with the same uncertainty, expected many different ones to measure")
    return np.stack([x, y, chance], axis=1)[apart]


def _pooled(values: Array) -> Array:
    """The ascending values nearest to these in the least squares: neighbours in the wrong order get their mean."""
    blocks: list[list[float]] = []  # mean, count
    for value in values.tolist():
        blocks.append([value, 1])
        while len(blocks) > 1 and blocks[-2][0] > blocks[-1][0]:
            mean, count = blocks.pop()
            total = blocks[-1][1] + count
            blocks[-1] = [(blocks[-1][0] * blocks[-1][1] + mean * count) / total, total]
    return np.repeat([mean for mean, _ in blocks], [int(count) for _, count in blocks])
