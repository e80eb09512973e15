"""The cameras of whole scenes."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from handpose.frames.cameras import FINDER_FOCAL_PX, Floats
from handpose.synthetic.scenes.draws import Draw
from handpose.synthetic.scenes.prior import ViewParameter
from handpose.synthetic.scenes.solids import Rays
from netlib.blob import Array

HEIGHT, WIDTH = 128, 160  # px of the frames
MIN_PROJECTED_MM = 50.0  # nearer points are projected as if they were at this depth


class Cameras(NamedTuple):
    """The cameras of N frames.

    focal, u0, v0  (N,) px
    on_head        (N,) whether a person wears it on the head
    facing         (N,) whether it is in front of the person
    up             (N, 3) the direction upwards
    """

    focal: Array
    u0: Array
    v0: Array
    on_head: NDArray[np.bool_]
    facing: NDArray[np.bool_]
    up: Array

    def rays(self, finer: int = 1) -> Rays:
        """Slopes (N, finer * WIDTH) of the columns and (N, finer * HEIGHT) of the rows, downwards.

        finer  factor of the frames' resolution
        """
        column, row = (np.arange(finer * size) / finer for size in (WIDTH, HEIGHT))
        x = (column - self.u0[:, None]) / self.focal[:, None]
        y = (row - self.v0[:, None]) / self.focal[:, None]
        return x.astype(np.float32), y.astype(np.float32)

    def pixels(self, xyz: Array) -> Array:
        """Columns and rows (N, ..., 2) of points (N, ..., 3)."""
        x, y, z = np.moveaxis(xyz, -1, 0)
        per_frame = (-1, *[1] * (z.ndim - 1))
        f, u0, v0 = (value.reshape(per_frame) for value in (self.focal, self.u0, self.v0))
        z = np.maximum(z, MIN_PROJECTED_MM)
        u, v = u0 + f * x / z, v0 - f * y / z
        return np.stack([u, v], axis=-1)

    def at(self, u: Array, v: Array, z: Array) -> Array:
        """The points (N, 3) at pixels and depths (N,)."""
        x = (u - self.u0) / self.focal * z
        y = (self.v0 - v) / self.focal * z
        return np.stack([x, y, z], axis=-1)

    def anywhere(self, draw: Draw, margin: float, z: Array) -> Array:
        """Random points (N, 3) at depths (N,), ``margin`` px or more inside the frames' borders."""
        u = draw.between(margin, WIDTH - margin)
        v = draw.between(margin, HEIGHT - margin)
        return self.at(u, v, z)


def draw_cameras(draw: Draw, prior: ViewParameter) -> Cameras:
    """Cameras worn on a head, in front of a person, or anywhere; held in any way."""
    focal = FINDER_FOCAL_PX * draw(prior.focal)
    u0 = WIDTH / 2 + draw.between(-prior.shift_x, prior.shift_x)
    v0 = HEIGHT / 2 + draw.between(-prior.shift_y, prior.shift_y)
    kind = draw.rng.random(draw.count)
    on_head, facing = kind < prior.on_head, kind > 1 - prior.facing
    pitch = np.where(on_head, draw(prior.pitch_on_head), draw(prior.pitch))
    any_roll = draw.chance(np.where(on_head, prior.any_roll_on_head, prior.any_roll))
    roll = np.where(any_roll, draw.between(-180, 180), prior.roll * draw.normal())
    pitch, roll = np.deg2rad(pitch), np.deg2rad(roll)
    x, y = np.cos(pitch) * np.sin(roll), np.cos(pitch) * np.cos(roll)
    up = np.stack([x, y, -np.sin(pitch)], axis=1)
    return Cameras(focal, u0, v0, on_head, facing, up)


def slopes_of(rays: Rays) -> Floats:
    """Slopes (N, H, W, 2) x / z and y / z, upwards, of the rays through all pixels."""
    x, y = rays
    return np.stack(np.broadcast_arrays(x[:, None, :], -y[:, :, None]), axis=-1)
