"""Support of poses by a depth image: which parts of a hand's own surface were seen, and which the
image contradicts.

The rays of a regular grid over the hand sample the surface that faces the camera. Each ray whose
first intersection is with the hand's own parts has the same weight, so a part has the weight of its
visible area. Such a ray is

    seen     the reading is within a tolerance of the surface
    hidden   the reading is nearer: another object covers the hand there
    empty    the reading is farther: the pose is in empty space
    missing  there is no reading
    outside  it is outside the image

A ray is compared with its pixel and the four adjacent ones, of which the reading nearest to the
surface is used: at an outline, a pixel may show the background, or have no reading.

A fit to the visible part of a covered hand has small residuals, so its cost does not show that the
rest is a guess. Joints are compared with the readings, too: those far behind the surface are hidden
by the hand itself, and those in front of it are in empty space.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from handpose.body.capsules import Capsules, in_front
from handpose.body.render import depths_of
from handpose.fit.settings import SupportSettings
from handpose.frames.cameras import Camera, Floats
from netlib.blob import Array

# Rays on each side of the grid. On 28 frames of P3, P7 and a Kinect v2, the mean differences of the
# shares from those of 96 rays without adjacent pixels are at most 0.05.
RAYS = 24
# rows and columns from a ray's pixel
AROUND = np.argwhere(cv2.getStructuringElement(cv2.MORPH_CROSS, (3, 3))) - 1
BEYOND_MM = 1e5  # minimum depth of the specks that replace capsules behind the camera


class Support(NamedTuple):
    """Shares of the surface of N hands that faces the camera, (N,) each; their sum is 1."""

    seen: Array
    hidden: Array
    empty: Array
    missing: Array
    outside: Array


class JointDepths(NamedTuple):
    """Mean distances (N,) in mm of the joints of N hands from the readings at their pixels, up to
    a maximum each.

    behind  by which the joints are behind the readings: more than a finger's radius where the
            hand hides itself
    before  by which they are in front of them
    """

    behind: Array
    before: Array


class _Rays(NamedTuple):
    """A grid of rays over each of N hands: slopes x (N, W) and y (N, H), y DOWN."""

    x: Floats
    y: Floats

    @classmethod
    def over(cls, capsules: Capsules) -> _Rays:
        """The rays over all of some capsules."""
        bounds = []
        for end, radius in ((capsules.a, capsules.radius_a), (capsules.b, capsules.radius_b)):
            middle, reach = end[..., :2] * (1, -1), radius[..., None]
            bounds += [edge / end[..., 2:] for edge in (middle - reach, middle + reach)]
        slopes = np.concatenate(bounds, axis=1)  # (N, 4 M, 2)
        least, most = slopes.min(axis=1), slopes.max(axis=1)
        share = (np.arange(RAYS) + 0.5) / RAYS
        grid = least[..., None] + (most - least)[..., None] * share  # (N, 2, RAYS)
        return cls(*np.moveaxis(grid.astype(np.float32), 1, 0))

    def readings(
        self, surface: Floats, depth: NDArray[np.floating], camera: Camera
    ) -> tuple[Floats, NDArray[np.bool_]]:
        """The readings (N, H, W) that are nearest to a surface (N, H, W), 0 where there is none,
        and True where the surface is in the image.
        """
        columns = np.rint(self.x * camera.fx + camera.u0).astype(np.int64)[:, None, :]
        rows = np.rint(self.y * camera.fy + camera.v0).astype(np.int64)[:, :, None]
        found = np.zeros(surface.shape, np.float32)
        least = np.full(surface.shape, np.inf, np.float32)
        for down, right in AROUND:
            row = np.clip(rows + down, 0, camera.height - 1)
            reading = depth[row, np.clip(columns + right, 0, camera.width - 1)]
            apart = np.where(reading > 0, np.abs(reading - surface), np.float32(np.inf))
            is_nearer = apart < least
            found[is_nearer], least[is_nearer] = reading[is_nearer], apart[is_nearer]
        return found, camera.has_pixel(columns, rows) & (surface < BEYOND_MM)


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
        body = in_front(capsules)
        rays = _Rays.over(body.chosen(~limbs))
        shapes = depths_of(body, *rays)
        surface = shapes.min(axis=1)
        reading, inside = rays.readings(surface, depth, camera)
        behind, tolerance = reading - surface, self.settings.tolerance_mm
        read = inside & (reading > 0)
        hidden, empty = read & (behind < -tolerance), read & (behind > tolerance)
        seen = read & ~hidden & ~empty
        kinds = np.stack([seen, hidden, empty, inside & ~read, ~inside])
        found = []
        for part in (~limbs, *parts):
            own = shapes[:, _shapes_of(part, capsules.facets)].min(axis=1, initial=np.inf)
            shown = np.isfinite(own) & (own <= surface + self.settings.self_mm)
            count = np.maximum(shown.sum(axis=(1, 2)), 1)
            found.append(Support(*((kinds & shown).sum(axis=(2, 3)) / count)))
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


def _shapes_of(some: NDArray[np.bool_], facets: NDArray[np.int_]) -> NDArray[np.bool_]:
    """True (M + T,) for some capsules (M,), and for the flat parts that are between these alone."""
    return np.concatenate([some, some[facets // 2].all(axis=1)])


def _readings(
    points: Array, depth: NDArray[np.floating], camera: Camera
) -> tuple[NDArray[np.floating], NDArray[np.bool_]]:
    """The readings (N, P) at the pixels of points (N, P, 3) in mm, and True where these
    are in the image.
    """
    before = points[..., 2] > 0
    pixels = np.rint(camera.project(np.where(before[..., None], points, 1.0)))
    column, row, _ = np.moveaxis(pixels, -1, 0)
    inside = before & camera.has_pixel(column, row)
    at = [np.where(inside, index, 0).astype(np.int64) for index in (row, column)]
    return depth[at[0], at[1]], inside
