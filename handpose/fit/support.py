"""Support of poses by a depth image: which parts of a hand's own surface were seen, and which the
image contradicts.

Spheres along the capsules, and on the flat parts between them, sample the surface that faces the
camera. Of those that no other part of the body covers, each counts in proportion to its area as

    seen     the reading is within a tolerance of the sphere's front
    hidden   the reading is nearer: another object covers the hand there
    empty    the reading is farther: the pose is in empty space
    missing  there is no reading
    outside  it is outside the image

A fit to the visible part of a covered hand has small residuals, so its cost does not show that the
rest is a guess. Joints are compared with the readings, too: those far behind the surface are hidden
by the hand itself, and those in front of it are in empty space.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from handpose.body.render import Capsules
from handpose.fit.settings import SupportSettings
from handpose.frames.cameras import Camera
from netlib.blob import Array

ALONG = np.array([1, 3]) / 4  # positions of the spheres on a capsule's axis
ACROSS = np.array([[1, 1, 1]]) / 3  # of those on a flat part, between its corners


class Support(NamedTuple):
    """Shares of the surface of N hands that faces the camera, (N,) each; their sum is 1."""

    seen: Array
    hidden: Array
    empty: Array
    missing: Array
    outside: Array

    @property
    def covered(self) -> Array:
        """The share (N,) that is in the image but was not read, because of a nearer object or
        without a reading.
        """
        return self.hidden + self.missing


class JointDepths(NamedTuple):
    """Mean distances (N,) in mm of the joints of N hands from the readings at their pixels, up to
    a maximum each.

    behind  by which the joints are behind the readings: more than a finger's radius where the
            hand hides itself
    before  by which they are in front of them
    """

    behind: Array
    before: Array


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
        centers = a[:, :, None] + along * (b - a)[:, :, None]  # (N, M, A, 3)
        radii = ra[:, :, None] + ALONG * (rb - ra)[:, :, None]
        length = np.linalg.norm(b - a, axis=2, keepdims=True) / len(ALONG)
        areas = 2 * radii * length
        center, radius = [centers.reshape(n, -1, 3)], [radii.reshape(n, -1)]
        area = [areas.reshape(n, -1)]
        if len(facets):
            ends = np.stack([a, b], axis=2).reshape(n, -1, 3)
            end_radii = np.stack([ra, rb], axis=2).reshape(n, -1)
            corner = ends[:, facets]
            r = end_radii[:, facets]  # (N, T, 3, 3), (N, T, 3)
            center.append((across * corner[:, :, None]).sum(axis=3).reshape(n, -1, 3))
            radius.append((ACROSS * r[:, :, None]).sum(axis=3).reshape(n, -1))
            edges = corner[:, :, 1:] - corner[:, :, :1]
            normal = np.cross(edges[:, :, 0], edges[:, :, 1])
            flat = np.linalg.norm(normal, axis=2) / 2 / len(ACROSS)
            area.append(np.repeat(flat, len(ACROSS), axis=1))
        return cls(*(np.concatenate(parts, axis=1) for parts in (center, radius, area)))

    def chosen(self, which: NDArray[np.bool_]) -> Samples:
        """Some of the spheres (P,)."""
        return Samples(self.center[:, which], self.radius[:, which], self.area[:, which])

    @property
    def front(self) -> Array:
        """The depths (N, P) of the spheres' nearest points."""
        return self.center[..., 2] - self.radius

    @property
    def nearest(self) -> Array:
        """The spheres' nearest points (N, P, 3)."""
        return np.concatenate([self.center[..., :2], self.front[..., None]], axis=2)

    def covers(self, points: Array, front: Array) -> NDArray[np.bool_]:
        """True (N, Q) where a sphere is in front of points (N, Q, 3) whose surface is at the
        depths (N, Q).
        """
        x, y, z = (self.center[:, None, :, axis] for axis in range(3))
        ray = points[..., :2] / points[..., 2:]
        off_x = ray[:, :, None, 0] * z - x
        off_y = ray[:, :, None, 1] * z - y
        inner = self.radius[:, None] ** 2 - off_x**2 - off_y**2
        before = z - np.sqrt(np.maximum(inner, 0)) < front[:, :, None]
        return np.asarray(((inner > 0) & before).any(axis=2))


class ImageSupport:
    """Compares poses with images."""

    def __init__(self, settings: SupportSettings) -> None:
        self.settings = settings

    def support(
        self,
        capsules: Capsules,
        limbs: NDArray[np.bool_],
        depth: NDArray[np.floating],
        camera: Camera,
    ) -> Support:
        """The support of N poses by one image (height, width) in mm, 0 without a reading.

        capsules  of the poses, in camera axes
        limbs     (M,) True for those that are not the hand's own, such as the forearm
        """
        return self.support_of_parts(capsules, limbs, (), depth, camera)[0]

    def support_of_parts(
        self,
        capsules: Capsules,
        limbs: NDArray[np.bool_],
        parts: Sequence[NDArray[np.bool_]],
        depth: NDArray[np.floating],
        camera: Camera,
    ) -> list[Support]:
        """``support`` of the whole hand, and then that of each part, some of the capsules (M,).

        All shares of a part that others cover entirely are 0.
        """
        every = Samples.of(capsules)
        own = _samples_of(~limbs, capsules.facets)
        spheres = every.chosen(own)
        reading, inside = _readings(spheres.nearest, depth, camera)
        # NaN, which some drivers write, is missing
        behind = reading - spheres.front
        missing = inside & ~(reading > 0)
        front = spheres.front - self.settings.self_mm
        tolerance = self.settings.tolerance_mm
        weight = spheres.area * ~every.covers(spheres.center, front)
        read = inside & ~missing
        hidden, empty = read & (behind < -tolerance), read & (behind > tolerance)
        areas = weight * np.stack([read & ~(hidden | empty), hidden, empty, missing, ~inside])
        found = []
        for part in (~limbs, *parts):
            within = _samples_of(part, capsules.facets)[own]
            whole = np.maximum(weight[:, within].sum(axis=1), 1e-9)
            found.append(Support(*(areas[:, :, within].sum(axis=2) / whole)))
        return found

    def joint_depths(
        self, joints: Array, depth: NDArray[np.floating], camera: Camera
    ) -> JointDepths:
        """The distances of joints (N, K, 3) in mm, camera axes, from the readings of one image; 0
        without any reading.
        """
        reading, inside = _readings(joints, depth, camera)
        read = inside & (reading > 0)
        behind = np.where(read, joints[..., 2] - np.where(read, reading, 0), 0)
        count = np.maximum(read.sum(axis=1), 1)
        most = self.settings.max_joint_depth_mm
        clipped = (np.clip(distance, 0, most) for distance in (behind, -behind))
        return JointDepths(*(distance.sum(axis=1) / count for distance in clipped))


def _samples_of(some: NDArray[np.bool_], facets: NDArray[np.int_]) -> NDArray[np.bool_]:
    """True (P,) for the samples of some capsules (M,), and of the flat parts that are
    between these alone.
    """
    flat = some[facets // 2].all(axis=1)
    return np.concatenate([np.repeat(some, len(ALONG)), np.repeat(flat, len(ACROSS))])


def _readings(
    points: Array, depth: NDArray[np.floating], camera: Camera
) -> tuple[NDArray[np.floating], NDArray[np.bool_]]:
    """The readings (N, P) at the pixels of points (N, P, 3) in mm, and True where these
    are in the image.
    """
    before = points[..., 2] > 0
    pixels = np.rint(camera.project(np.where(before[..., None], points, 1.0)))
    column, row, _ = np.moveaxis(pixels, -1, 0)
    in_width = (column >= 0) & (column < camera.width)
    in_height = (row >= 0) & (row < camera.height)
    inside = before & in_width & in_height
    at = [np.where(inside, index, 0).astype(np.int64) for index in (row, column)]
    return depth[at[0], at[1]], inside
