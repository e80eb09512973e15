"""Support of poses by a depth image: which parts of a hand's own surface were seen, and which the image contradicts.

Spheres along the capsules, and on the flat parts between them, sample the surface that faces the camera. Of those that
no other part of the body covers, each counts in proportion to its area as

    seen     the reading is within APART_MM of the sphere's front
    hidden   the reading is nearer: another object covers the hand there
    empty    the reading is farther: the pose is in empty space
    missing  there is no reading

A fit to the visible part of a covered hand has small residuals, so its cost does not show that the rest is a guess.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from handpose.body.render import Capsules
from handpose.frames.cameras import Camera
from netlib.blob import Array

APART_MM = 20.0  # a reading this far from the surface of a fit is of something else
SELF_MM = 5.0  # a sphere this far in front of another covers it
ALONG = np.array([1, 3]) / 4  # positions of the spheres on a capsule's axis
ACROSS = np.array([[1, 1, 1]]) / 3  # of those on a flat part, between its corners


class Support(NamedTuple):
    """Shares of the surface of N hands that is in the image and faces the camera, (N,) each; their sum is 1, or 0."""

    seen: Array
    hidden: Array
    empty: Array
    missing: Array


class Samples(NamedTuple):
    """P spheres of N bodies, in mm, camera axes, and the area that each stands for."""

    center: Array  # (N, P, 3)
    radius: Array  # (N, P)
    area: Array  # (N, P) mm2

    @classmethod
    def of(cls, capsules: Capsules) -> Samples:
        """The spheres of all capsules and facets."""
        along, across = ALONG[:, None], ACROSS[..., None]
        a, b, ra, rb, facets = capsules
        n = len(a)
        center = [(a[:, :, None] + along * (b - a)[:, :, None]).reshape(n, -1, 3)]
        radius = [(ra[:, :, None] + ALONG * (rb - ra)[:, :, None]).reshape(n, -1)]
        length = np.linalg.norm(b - a, axis=2, keepdims=True) / len(ALONG)
        area = [2 * radius[0] * np.repeat(length, len(ALONG), axis=2).reshape(n, -1)]
        if len(facets):
            ends, radii = np.stack([a, b], axis=2).reshape(n, -1, 3), np.stack([ra, rb], axis=2).reshape(n, -1)
            corner, r = ends[:, facets], radii[:, facets]  # (N, T, 3, 3), (N, T, 3)
            center.append((across * corner[:, :, None]).sum(axis=3).reshape(n, -1, 3))
            radius.append((ACROSS * r[:, :, None]).sum(axis=3).reshape(n, -1))
            edges = corner[:, :, 1:] - corner[:, :, :1]
            flat = np.linalg.norm(np.cross(edges[:, :, 0], edges[:, :, 1]), axis=2) / 2 / len(ACROSS)
            area.append(np.repeat(flat, len(ACROSS), axis=1))
        return cls(*(np.concatenate(parts, axis=1) for parts in (center, radius, area)))

    @property
    def front(self) -> Array:
        """The depths (N, P) of the spheres' nearest points."""
        return np.asarray(self.center[..., 2] - self.radius)

    def covers(self, points: Array, front: Array) -> NDArray[np.bool_]:
        """True (N, Q) where a sphere is in front of points (N, Q, 3) whose surface is at the depths (N, Q)."""
        x, y, z = (self.center[:, None, :, axis] for axis in range(3))
        ray = points[..., :2] / points[..., 2:]
        inner = self.radius[:, None] ** 2 - (ray[:, :, None, 0] * z - x) ** 2 - (ray[:, :, None, 1] * z - y) ** 2
        before = z - np.sqrt(np.maximum(inner, 0)) < front[:, :, None] - SELF_MM
        return np.asarray(((inner > 0) & before).any(axis=2))


def support(capsules: Capsules, limbs: NDArray[np.bool_], depth: NDArray[np.floating], camera: Camera) -> Support:
    """The support of N poses by one image (height, width) in mm, 0 without a reading.

    capsules  of the poses, in camera axes
    limbs     (M,) True for those that are not the hand's own, such as the forearm
    """
    own = Samples.of(capsules.chosen(~limbs))
    front = own.front
    column, row, _ = np.moveaxis(
        np.rint(camera.project(np.concatenate([own.center[..., :2], front[..., None]], axis=2))), 2, 0
    )
    inside = (column >= 0) & (column < camera.width) & (row >= 0) & (row < camera.height) & (front > 0)
    at = [np.where(inside, index, 0).astype(np.int64) for index in (row, column)]
    reading = depth[at[0], at[1]]
    behind, missing = reading - front, ~(reading > 0)  # NaN, which some drivers write, is missing
    weight = own.area * (inside & ~Samples.of(capsules).covers(own.center, front))
    whole = np.maximum(weight.sum(axis=1), 1e-9)
    hidden, empty = ~missing & (behind < -APART_MM), ~missing & (behind > APART_MM)
    parts = (~(hidden | empty | missing), hidden, empty, missing)
    return Support(*((weight * part).sum(axis=1) / whole for part in parts))
