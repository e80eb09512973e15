"""Scores of poses: joint errors in mm, success rates, violated limits.

Every figure on NYU is over the 14 ``EVALUATION_JOINTS`` of ``handpose.body.nyu``
(indices of the model's 31), and is meaningless without the centre of its crops, which for NYU is
the annotated joint 34.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from handpose.body.nyu import EVALUATION_JOINTS
from netlib.blob import Array
from netlib.errors import DataError


def joint_errors(predicted: ArrayLike, truth: ArrayLike) -> Array:
    """Distances (N, K) in mm between joints (N, K, 3) in mm.

    Raises DataError if the shapes differ.
    """
    p, t = np.asarray(predicted, dtype=np.float64), np.asarray(truth, dtype=np.float64)
    if p.shape != t.shape or p.ndim != 3 or p.shape[-1] != 3:
        raise DataError(
            f"predicted joints {p.shape} and true joints {t.shape}, expected the same (N, K, 3)"
        )
    return np.linalg.norm(p - t, axis=-1)


def mean_errors_14(predicted: ArrayLike, truth: ArrayLike) -> Array:
    """Means (N,) of ``joint_errors`` over NYU's 14 joints, of joints (N, 31, 3) in mm."""
    few = list(EVALUATION_JOINTS)
    errors = joint_errors(np.asarray(predicted)[:, few], np.asarray(truth)[:, few])
    return errors.mean(axis=1)


def success_rate(errors: Array, thresholds: ArrayLike, worst: bool = True) -> Array:
    """Fraction (T,) of frames whose worst (or, with ``worst=False``, mean) joint error is <= each
    threshold, mm.

    errors      (N, K) mm
    thresholds  (T,) mm
    """
    frame = np.sort(errors.max(axis=1) if worst else errors.mean(axis=1))
    return np.searchsorted(frame, np.asarray(thresholds, dtype=np.float64), side="right") / len(
        frame
    )


def fraction_out_of_limits(
    inputs: ArrayLike, lower: ArrayLike, upper: ArrayLike, fixed: ArrayLike, tolerance: float = 0.0
) -> float:
    """Fraction of frames with any free parameter more than ``tolerance`` beyond its limits.

    inputs               (N, D) parameters without the initial pose, the numbers that
                         limits apply to
    lower, upper, fixed  (D,) limits, and which parameters have none because they are fixed:
                         as in a Skeleton
    """
    x = np.asarray(inputs, dtype=np.float64)
    broken = (x < np.asarray(lower) - tolerance) | (x > np.asarray(upper) + tolerance)
    return float((broken & ~np.asarray(fixed, dtype=bool)).any(axis=1).mean())
