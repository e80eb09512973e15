"""Capsules: the convex hulls of two spheres each, of which the surface of a body consists."""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from handpose.frames.cameras import Array

CLEAR_MM = 40.0  # minimum distance from the camera's plane
_FAR, _SPECK = 1e6, 1e-3  # mm: distance and radius of an invisible sphere

NO_FACETS: NDArray[np.int_] = np.zeros((0, 3), dtype=int)


class Capsules(NamedTuple):
    """M capsules in each of N frames: two end points in mm, camera axes (y up), and
    their radii in mm.

    facets  (T, 3) the same in all frames: the spheres between which the surface is flat, 2 m for
            the end a of capsule m, 2 m + 1 for its end b
    """

    a: Array  # (N, M, 3)
    b: Array  # (N, M, 3)
    radius_a: Array  # (N, M)
    radius_b: Array  # (N, M)
    facets: NDArray[np.int_] = NO_FACETS

    def moved(self, by: ArrayLike) -> Capsules:
        """All ends moved by (3,), or by (N, 3)."""
        by = np.asarray(by, dtype=np.float64).reshape(-1, 1, 3)
        return self._replace(a=self.a + by, b=self.b + by)

    def mirrored(self, axes: Array) -> Capsules:
        """All ends multiplied by (3,), or by (N, 3)."""
        axes = axes.reshape(-1, 1, 3)
        return self._replace(a=self.a * axes, b=self.b * axes)

    def part(self, first: Array, last: Array) -> Capsules:
        """The parts from one fraction of their length to another, (N, M) or (N, 1)."""
        along, wider = self.b - self.a, self.radius_b - self.radius_a
        a, b = (self.a + at[..., None] * along for at in (first, last))
        ra, rb = (self.radius_a + at * wider for at in (first, last))
        return Capsules(a, b, ra, rb, self.facets)

    def frames(self, rows: slice | NDArray[np.int_]) -> Capsules:
        """The capsules of some frames."""
        return Capsules(
            self.a[rows], self.b[rows], self.radius_a[rows], self.radius_b[rows], self.facets
        )

    def chosen(self, which: NDArray[np.bool_]) -> Capsules:
        """Some of the capsules (M,), and the facets all of whose spheres are among them."""
        number = np.cumsum(which) - 1
        facets = self.facets[which[self.facets // 2].all(axis=1)]
        a, b, ra, rb = (values[:, which] for values in self[:4])
        return Capsules(a, b, ra, rb, 2 * number[facets // 2] + facets % 2)


def joined(parts: Iterable[Capsules]) -> Capsules:
    """The capsules of several bodies together, frame by frame."""
    every = list(parts)
    before = np.cumsum([0, *(one.a.shape[1] for one in every)])
    facets = [one.facets + 2 * first for one, first in zip(every, before)]
    by_field = zip(*(one[:4] for one in every))
    a, b, ra, rb = (np.concatenate(values, axis=1) for values in by_field)
    return Capsules(a, b, ra, rb, np.concatenate(facets))


def in_front(capsules: Capsules, clear_mm: ArrayLike = CLEAR_MM) -> Capsules:
    """The parts of capsules farther than this in mm, one or (N,), from the camera's plane; others
    become specks.
    """
    clear = np.maximum(np.asarray(clear_mm, dtype=np.float64).reshape(-1, 1), CLEAR_MM)
    nearest = capsules.a[..., 2] - capsules.radius_a, capsules.b[..., 2] - capsules.radius_b
    near = [depth - clear for depth in nearest]
    change = np.where(near[1] == near[0], 1.0, near[1] - near[0])
    first = np.where(near[0] < 0, np.clip(-near[0] / change, 0, 1), 0.0)
    last = np.where(near[1] < 0, np.clip(-near[0] / change, 0, 1), 1.0)
    away = (near[0] < 0) & (near[1] < 0)
    a, b, ra, rb, facets = capsules.part(first, last)
    a, b = (np.where(away[..., None], (0.0, 0.0, _FAR), end) for end in (a, b))
    ra, rb = (np.where(away, _SPECK, radius) for radius in (ra, rb))
    return Capsules(a, b, ra, rb, facets)
