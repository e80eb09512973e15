"""Candidate places of hands in a depth image, and the crops of them that a locator sees, with room for an arm.

A hand is on a visible surface, so the surface is cut into voxels; the mean of each is a place.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from handpose.frames.cameras import Camera
from handpose.frames.crops import Window, check_size, crops_of_windows, window
from netlib.blob import Array

CUBE_MM = 400.0  # edge of a place's cube: the hand and the wrist
SIZE = 64  # pixels on a side
VOXEL_MM = 80.0  # edge of a voxel
BEHIND_MM = 20.0  # from the visible surface to a hand's middle
FAR_MM = 1600.0  # maximum depth; a hand farther away has too few pixels
MIN_DEPTH_MM = 100.0  # minimum range of depth cameras
MIN_AREA_MM2 = 300.0  # minimum surface in a voxel; less is noise
AROUND_MM, CONTINUED_MM, DIRECTIONS, SAMPLES = 130.0, 35.0, 12, 7  # see ``extent_around``
NODES_ACROSS = 160  # pixels sampled in a row


def surface_places(depth: ArrayLike, camera: Camera) -> Array:
    """Places (P, 3) in mm, camera axes, in a depth image (height, width) in mm, 0 where there is no reading.

    Only surfaces nearer than FAR_MM count; the image is subsampled to NODES_ACROSS pixels in a row. A voxel with less
    than MIN_AREA_MM2 of surface is no place. Raises DataError.
    """
    image = np.asarray(depth)
    check_size(image, camera)
    step = max(1, image.shape[1] // NODES_ACROSS)
    rows, columns = np.mgrid[step // 2 : image.shape[0] : step, step // 2 : image.shape[1] : step]
    z = image[rows, columns].astype(np.float64)
    seen = np.isfinite(z) & (z > 0) & (z < FAR_MM)
    points = camera.unproject(np.stack([columns[seen], rows[seen], z[seen]], axis=1))
    if not len(points):
        return np.zeros((0, 3))
    voxels, own = np.unique(np.floor(points / VOXEL_MM).astype(np.int64), axis=0, return_inverse=True)
    own, count = own.reshape(-1), len(voxels)
    area = np.bincount(own, (points[:, 2] * step) ** 2 / (camera.fx * camera.fy), count)
    nodes = np.bincount(own, minlength=count)
    means = np.stack([np.bincount(own, values, count) / nodes for values in points.T], axis=1)
    return np.asarray(means[area > MIN_AREA_MM2] + (0, 0, BEHIND_MM))


def extent_around(depth: NDArray[np.generic], places: Array, camera: Camera) -> Array:
    """The share (P,) of directions in the image in which the surface at places (P, 3) continues beyond a hand.

    It is small for a hand, because only the forearm continues, and large in the middle of a table, a wall or a trunk.
    A surface continues in a direction if its readings up to AROUND_MM have no depth step.
    """
    if not len(places):
        return np.zeros(0)
    angle = 2 * np.pi * np.arange(DIRECTIONS) / DIRECTIONS
    radius = np.linspace(0, AROUND_MM, SAMPLES)
    ring = np.zeros((DIRECTIONS, SAMPLES, 3))
    ring[..., 0], ring[..., 1] = np.outer(np.cos(angle), radius), np.outer(np.sin(angle), radius)
    uvd = camera.project((places[:, None, None] + ring).reshape(-1, 3))
    u, v = np.rint(uvd[:, :2]).astype(np.int64).T
    inside = (u >= 0) & (u < camera.width) & (v >= 0) & (v < camera.height)
    read = np.where(inside, np.asarray(depth)[np.where(inside, v, 0), np.where(inside, u, 0)], 0.0)
    read = read.reshape(len(places), DIRECTIONS, SAMPLES)
    steps = np.abs(np.diff(read, axis=2)).max(axis=2)
    return np.asarray(((steps < CONTINUED_MM) & (read > 0).all(axis=2)).mean(axis=1))


def place_crops(depth: NDArray[np.generic], places: Array, camera: Camera) -> tuple[NDArray[np.float32], Array]:
    """The crops (n, SIZE, SIZE) in [-1, 1] of the places (P, 3) that are in the image, and these places (n, 3), mm.

    Places closer to the camera than MIN_DEPTH_MM are left out. Raises DataError for an image of another size.
    """
    check_size(depth, camera)
    before = places[places[:, 2] > MIN_DEPTH_MM]
    if not len(before):
        return np.zeros((0, SIZE, SIZE), np.float32), before
    uvd = camera.project(before)
    picked = window(uvd, CUBE_MM, camera, SIZE)
    shown = (picked.columns >= 0).any(axis=1) & (picked.rows >= 0).any(axis=1)
    return crops_of_windows(depth, Window(*(index[shown] for index in picked)), uvd[shown, 2], CUBE_MM), before[shown]
