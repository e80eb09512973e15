"""Directions and rotations."""

from __future__ import annotations

import numpy as np

from netlib.blob import Array


def unit(v: Array) -> Array:
    """Vectors (..., 3) of length 1."""
    return v / np.linalg.norm(v, axis=-1, keepdims=True)


def across(v: Array, direction: Array) -> Array:
    """The part of vectors at a right angle to a direction of length 1."""
    return v - dot(v, direction)[..., None] * direction


def dot(v: Array, w: Array) -> Array:
    """Scalar products (...) of vectors (..., 3)."""
    return (v * w).sum(-1)


def right_angled(x: Array, y: Array) -> Array:
    """Axes (..., 3, 3) in columns: two at a right angle, and the third."""
    return np.stack([x, y, np.cross(x, y)], axis=-1)


def turned(turns: Array, v: Array) -> Array:
    """Vectors (N, 3) turned by each of K rotations (N, K, 3, 3)."""
    return np.einsum("nkij,nj->nki", turns, v)
