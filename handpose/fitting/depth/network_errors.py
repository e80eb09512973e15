"""How a network errs, and what a fit after it is worth: measured once, kept in the file of the weights.

A file of weights in Caffe's HDF5 layout has a group ``data``; beside it stands a group ``fit`` that Caffe does not look
at:

    fit/limbs          (L, L) covariance of the errors of the limbs' inputs: where else to start, how near to stay
    fit/PLAN           (k, 3) of each plan, ascending: misfit, expected error in mm, chance of an error below 30 mm
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import h5py
import numpy as np

from handpose.fitting.depth.body import FleshModel
from netlib.blob import Array
from netlib.errors import DataError, reason_of

GROUP = "fit"
LIMBS = "limbs"
GOOD_MM = 30.0  # a fit with a larger error has failed
UNKNOWN_STD = 0.3  # radians: what a network's limbs are taken to be off by when nobody has measured it
KNOTS = 24  # of a table


@dataclass(frozen=True)
class NetworkErrors:
    """What is known of a network that a fit starts from.

    limbs   (L, L) covariance of the errors of the limbs' inputs
    tables  per plan (k, 3): misfit, expected error in mm, chance of an error below GOOD_MM; none where not measured
    """

    limbs: Array
    tables: dict[str, Array]

    def expected(self, plan: str, misfit: Array) -> tuple[Array, Array]:
        """The expected error in mm (N,), and the chance (N,) that it is below GOOD_MM; NaN where not measured.

        With a misfit beyond all that were measured, the error grows in proportion, and the chance falls.
        """
        table = self.tables.get(plan)
        if table is None:
            return np.full(len(misfit), np.nan), np.full(len(misfit), np.nan)
        beyond = np.maximum(misfit / table[-1, 0], 1)
        return (
            np.interp(misfit, table[:, 0], table[:, 1]) * beyond,
            np.interp(misfit, table[:, 0], table[:, 2]) / beyond,
        )


def unknown_errors(model: FleshModel) -> NetworkErrors:
    """Of a network that nobody has measured."""
    return NetworkErrors(np.eye(len(model.limbs)) * UNKNOWN_STD**2, {})


def read_errors(path: str | Path, model: FleshModel) -> NetworkErrors:
    """Those that stand in a file of weights, or those of an unknown network. Raises DataError."""
    if not h5py.is_hdf5(path):
        return unknown_errors(model)
    try:
        with h5py.File(path, "r") as file:
            if GROUP not in file:
                return unknown_errors(model)
            found = {name: np.asarray(item, dtype=np.float64) for name, item in file[GROUP].items()}
    except (OSError, ValueError, RuntimeError, TypeError, AttributeError) as error:
        raise DataError(f"{path}: cannot read the group {GROUP!r}: {reason_of(error)}") from error
    limbs = found.pop(LIMBS, np.zeros(0))
    L = len(model.limbs)
    if limbs.shape != (L, L) or not np.isfinite(limbs).all() or np.linalg.eigvalsh(limbs).min(initial=1.0) <= 0:
        raise DataError(f"{path}: {GROUP}/{LIMBS} of shape {limbs.shape}, expected a covariance ({L}, {L})")
    for name, table in found.items():
        good = table.ndim == 2 and table.shape[1:] == (3,) and len(table) > 1 and np.isfinite(table).all()
        if not good or (np.diff(table[:, 0]) <= 0).any():
            raise DataError(f"{path}: {GROUP}/{name} of shape {table.shape}, expected rows of misfit, error, chance")
    return NetworkErrors(limbs, found)


def covariance(errors: Array) -> Array:
    """(L, L) of errors (N, L), about 0."""
    return np.asarray(errors.T @ errors / len(errors))


def table_of(misfit: Array, error_mm: Array) -> Array:
    """The table (k, 3) of fits with these misfits and errors (N,).

    Means of groups of equal size, made ascending by pooling neighbours that are not (isotonic regression).
    """
    order = np.argsort(misfit, kind="stable")
    groups = np.array_split(order, min(KNOTS, len(order)))
    x = np.array([misfit[g].mean() for g in groups])
    y = _pooled(np.array([error_mm[g].mean() for g in groups]))
    chance = 1 - _pooled(np.array([(error_mm[g] > GOOD_MM).mean() for g in groups]))
    apart = np.append(True, np.diff(x) > 0)
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
