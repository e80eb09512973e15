"""Rotations between sets of points."""

from __future__ import annotations

import numpy as np

from netlib.blob import Array


def best_rotation(rest: Array, found: Array) -> Array:
    """The rotation R (3, 3) that moves points (N, 3) best onto others (N, 3), both about a common origin.

    It minimises sum_k |found_k - R rest_k|²: R = U diag(1, 1, det(U Vᵀ)) Vᵀ with sum_k found_k rest_kᵀ = U S Vᵀ
    (Kabsch, 1976).
    """
    U, _, Vt = np.linalg.svd(found.T @ rest)
    return np.asarray(U @ np.diag([1, 1, np.linalg.det(U @ Vt)]) @ Vt)
