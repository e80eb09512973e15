"""Depth of solids and planes in whole frames."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from handpose.body.capsules import Capsules, in_front
from handpose.body.render import render
from handpose.frames.cameras import Floats
from netlib.blob import Array

BOX, CYLINDER, ELLIPSOID = 0, 1, 2
SHAPES = {"BOX": BOX, "CYLINDER": CYLINDER, "ELLIPSOID": ELLIPSOID}
# the axes of a shape along which it is flat, and those in which it is round
FORMS: dict[int, tuple[list[int], list[int]]] = {
    BOX: ([0, 1, 2], []),
    CYLINDER: ([1], [0, 2]),
    ELLIPSOID: ([], [0, 1, 2]),
}
NEAR_MM = 60.0  # solids that begin nearer are left out
NOTHING = np.float32(np.inf)  # the depth where there is no surface
Rays = tuple[Floats, Floats]  # slopes of the columns (N, W), and of the rows (N, H), downwards


class Solids(NamedTuple):
    """M boxes, cylinders or ellipsoids in each of N frames; ``shown`` (N, M) are there."""

    kind: NDArray[np.int_]  # (N, M)
    center: Array  # (N, M, 3)
    axes: Array  # (N, M, 3, 3) columns; a cylinder's length lies along the second
    half: Array  # (N, M, 3) half lengths along the axes
    shown: NDArray[np.bool_]


def one_each(*values: Array) -> Solids:
    """One solid in each frame: kind (N,), center (N, 3), axes (N, 3, 3), half, and shown (N,)."""
    return Solids(*(value[:, None] for value in values))


def joined(parts: Sequence[Solids]) -> Solids:
    """The solids of several groups together, frame by frame."""
    return Solids(*(np.concatenate(values, axis=1) for values in zip(*parts)))


class Layer(NamedTuple):
    """What a group of objects shows: depth (N, H, W), infinite where there is nothing, and the
    number of the object (N, H, W) in its frame.
    """

    depth: Floats
    number: NDArray[np.int16]

    def only(self, there: NDArray[np.bool_]) -> Layer:
        """The layer in those frames where it is there (N,)."""
        return self._replace(depth=only(self.depth, there))


def layer_of(depth: Floats, number: int) -> Layer:
    """The layer of one object in each frame."""
    return Layer(depth, np.full(depth.shape, number, np.int16))


def nearest(layers: Sequence[Layer]) -> Layer:
    """What is in front of all others; object 0 where there is nothing."""
    depth, number = layers[0].depth.copy(), layers[0].number.copy()
    for layer in layers[1:]:
        nearer = layer.depth < depth
        np.copyto(depth, layer.depth, where=nearer)
        np.copyto(number, layer.number, where=nearer)
    number[np.isinf(depth)] = 0
    return Layer(depth, number)


def only(depth: Floats, there: NDArray[np.bool_]) -> Floats:
    """Depth (N, H, W) of the frames in which something is there (N,), else infinite."""
    return np.where(there[:, None, None], depth, NOTHING)


def capsule_depth(capsules: Capsules, rays: Rays) -> Floats:
    """Depth (N, H, W) of capsules, infinite where there is none."""
    return render(in_front(capsules), *rays, np.full(len(capsules.a), np.inf))


def shown(capsules: Capsules, there: NDArray[np.bool_]) -> Capsules:
    """Capsules of which those not there (N, M) become invisible."""
    behind = np.array([0.0, 0.0, -1e4])  # in_front takes them away
    keep = there[..., None]
    a, b = (np.where(keep, end, behind) for end in (capsules.a, capsules.b))
    return capsules._replace(a=a, b=b)


def plane_depth(normal: Array, offset: Array, rays: Rays) -> Floats:
    """Depth (N, H, W) of the planes of points p with normal . p = offset; infinite where a ray
    misses.
    """
    x, y = rays
    n = normal.astype(np.float32)[:, :, None, None]
    slope = n[:, 0] * x[:, None, :] - n[:, 1] * y[:, :, None] + n[:, 2]
    with np.errstate(divide="ignore", invalid="ignore"):
        depth = offset.astype(np.float32)[:, None, None] / slope
    return np.where(depth > NEAR_MM, depth, NOTHING)


def solid_layer(solids: Solids, first: int, rays: Rays) -> Layer:
    """The nearest of solids, whose objects have the numbers from ``first`` on."""
    x, y = rays
    depth = np.full((len(x), y.shape[1], x.shape[1]), NOTHING)
    number = np.zeros(depth.shape, np.int16)
    signs = np.array(np.meshgrid(*[(-1, 1)] * 3)).reshape(3, -1).T
    for n, m in np.argwhere(solids.shown):
        axes, half, center = solids.axes[n, m], solids.half[n, m], solids.center[n, m]
        corners = center + (signs * half) @ axes.T
        if corners[:, 2].min() < NEAR_MM:
            continue
        rows, columns = _part_around(corners, x[n], y[n])
        part = depth[n, rows, columns]
        if part.size:
            entry = _entry(int(solids.kind[n, m]), center, axes, half, x[n, columns], y[n, rows])
            nearer = entry < part
            np.copyto(part, entry, where=nearer)
            number[n, rows, columns][nearer] = first + m
    return Layer(depth, number)


def _part_around(corners: Array, x: Floats, y: Floats) -> tuple[slice, slice]:
    """The rows and columns of a frame, with rays of slopes x (W,) and y (H,), that may show what
    lies between corners (8, 3).
    """
    slopes = corners[:, :2] / corners[:, 2:] * (1, -1)
    (left, top), (right, bottom) = slopes.min(axis=0), slopes.max(axis=0)
    columns = np.searchsorted(x, (left, right))
    rows = np.searchsorted(y, (top, bottom))
    return slice(*rows), slice(*columns)


def _entry(kind: int, center: Array, axes: Array, half: Array, x: Floats, y: Floats) -> Floats:
    """Depth (h, w) at which rays enter a solid, computed where it is a cube, cylinder or sphere of
    half length 1.
    """
    to_solid = (axes / half).T.astype(np.float32)
    # the camera o and the directions d of the rays, in the axes of the solid
    o = -(to_solid @ center.astype(np.float32))
    d = [t[0] * x[None, :] - t[1] * y[:, None] + t[2] for t in to_solid]
    flat, rounded = FORMS[kind]
    enter, leave = np.full(d[0].shape, -NOTHING), np.full(d[0].shape, NOTHING)
    with np.errstate(divide="ignore", invalid="ignore"):
        for k in flat:
            lower = (-1 - o[k]) / d[k]
            upper = (1 - o[k]) / d[k]
            enter = np.fmax(enter, np.fmin(lower, upper))
            leave = np.fmin(leave, np.fmax(lower, upper))
        if rounded:
            dd = sum(d[k] * d[k] for k in rounded)
            do = sum(d[k] * o[k] for k in rounded)
            beyond = sum(o[k] * o[k] for k in rounded) - 1
            root = np.sqrt(do * do - dd * beyond)  # NaN where the ray misses
            enter = np.maximum(enter, (-do - root) / dd)
            leave = np.minimum(leave, (-do + root) / dd)
        return np.where(enter < leave, enter, NOTHING)
